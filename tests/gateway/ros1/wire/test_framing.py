from __future__ import annotations

import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.ros1.errors import TcprosError
from gateway.ros1.wire.framing import FIRST_STEP_BYTES, SCRATCH_BYTES, FrameReceiver


def feed(receiver: FrameReceiver, data: bytes) -> list[bytearray]:
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


@given(
    st.lists(st.integers(0, 3 * SCRATCH_BYTES) | st.integers(0, 5 * FIRST_STEP_BYTES), max_size=5),
    st.integers(1, 2 * SCRATCH_BYTES) | st.integers(1, 5 * FIRST_STEP_BYTES),
)
@example([FIRST_STEP_BYTES, FIRST_STEP_BYTES + 1, 2 * FIRST_STEP_BYTES, 2 * FIRST_STEP_BYTES + 1], FIRST_STEP_BYTES)
def test_frames_are_the_same_however_they_are_cut(sizes: list[int], piece: int) -> None:
    bodies = [bytes([i]) * size for i, size in enumerate(sizes)]
    stream = framed(*bodies)
    receiver = FrameReceiver(5 * FIRST_STEP_BYTES)
    frames = [
        frame for start in range(0, len(stream), piece) for frame in feed(receiver, stream[start : start + piece])
    ]
    assert frames == bodies


def test_frames_do_not_share_memory() -> None:
    first, second = feed(FrameReceiver(10), framed(b"one", b"two"))
    first[:] = b"xxx"
    assert second == b"two"


def test_large_frame_is_received_into_a_buffer_of_its_size_once_there_was_one_like_it() -> None:
    size = 10 * FIRST_STEP_BYTES
    receiver = FrameReceiver(size)
    feed(receiver, framed(bytes(size // 2)))
    assert feed(receiver, struct.pack("<I", size)) == []
    assert len(receiver.get_buffer()) == size


def test_announced_length_takes_no_memory() -> None:
    receiver = FrameReceiver(64 << 20)
    feed(receiver, struct.pack("<I", 64 << 20) + b"x")
    assert len(receiver.get_buffer()) == FIRST_STEP_BYTES - 1


@given(st.lists(st.integers(1, 1 << 20), min_size=1, max_size=20))
def test_buffer_grows_with_what_arrives(reads: list[int]) -> None:
    receiver = FrameReceiver(0xFFFFFFFF)
    feed(receiver, b"\xff\xff\xff\xff")
    arrived = 0
    for read in reads:
        free = len(receiver.get_buffer())
        assert 0 < free <= max(FIRST_STEP_BYTES, 2 * arrived) - arrived
        receiver.buffer_updated(min(read, free))
        arrived += min(read, free)
        assert receiver.next_frame() is None


def test_frame_of_the_largest_size_is_taken_and_one_byte_more_is_not() -> None:
    assert feed(FrameReceiver(5), framed(b"12345")) == [b"12345"]
    with pytest.raises(TcprosError, match="6 bytes, over the limit of 5"):
        feed(FrameReceiver(5), framed(b"123456"))


def test_cap_is_checked_before_the_body_comes() -> None:
    with pytest.raises(TcprosError):
        feed(FrameReceiver(1 << 20), b"\xff\xff\xff\xff")
