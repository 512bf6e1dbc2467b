"""Length-prefixed frames for tests."""

import struct

from gateway.ros1.wire.framing import FrameReceiver


def feed(receiver: FrameReceiver, data: bytes) -> list[memoryview]:
    """Feed as a socket does: at most as much as the buffer takes."""
    frames = []
    while data:
        buffer = receiver.get_buffer()
        assert buffer
        piece, data = data[: len(buffer)], data[len(buffer) :]
        buffer[: len(piece)] = piece
        receiver.buffer_updated(len(piece))
        while (frame := receiver.next_frame()) is not None:
            frames.append(frame)
    return frames


def framed(*bodies: bytes) -> bytes:
    return b"".join(struct.pack("<I", len(body)) + body for body in bodies)
