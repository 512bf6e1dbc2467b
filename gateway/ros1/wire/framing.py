"""Length-prefixed frames, received with one copy at most.

Small frames are cut out of a scratch buffer that takes many of them in one read. A frame larger than what the scratch
buffer holds gets a buffer of its own, into which the rest of it is received directly. Announcing a length costs no
memory: that buffer grows with what arrives, and is whole from the start where the previous frame was as large.
"""

from __future__ import annotations

from gateway.ros1.errors import TcprosError
from gateway.ros1.wire.header import LENGTH

SCRATCH_BYTES = 16 << 10
FIRST_STEP_BYTES = 64 << 10


class FrameReceiver:
    """Cuts a byte stream into frames of at most `max_frame_bytes`; the cap is checked before a frame is allocated.

    Holds, besides the scratch buffer, at most FIRST_STEP_BYTES or twice what arrived of this frame or of the last one.
    """

    def __init__(self, max_frame_bytes: int) -> None:
        self.max_frame_bytes = max_frame_bytes
        self._scratch = bytearray(SCRATCH_BYTES)
        self._start = 0
        self._end = 0
        self._body: bytearray | None = None
        self._length = 0
        self._filled = 0
        self._last_length = 0

    def get_buffer(self) -> memoryview:
        """Return where the next received bytes belong; never empty once `next_frame` has returned None."""
        if self._body is not None:
            return memoryview(self._body)[self._filled :]
        return memoryview(self._scratch)[self._end :]

    def buffer_updated(self, count: int) -> None:
        """Take `count` bytes written to the start of the last `get_buffer`."""
        if self._body is not None:
            self._filled += count
        else:
            self._end += count

    def next_frame(self) -> bytearray | None:
        """Return the next whole frame, or None: then more bytes are needed.

        Raises:
            TcprosError: the frame's length is over the cap.

        """
        if self._body is None:
            self._begin_body()
        body = self._body
        if body is None or self._filled < len(body):
            return None
        if self._filled < self._length:
            self._body = bytearray(min(self._length, 2 * self._filled))
            self._body[: self._filled] = body
            return None
        self._body, self._filled, self._last_length = None, 0, self._length
        return body

    def _begin_body(self) -> None:
        """Start the next frame with what the scratch buffer holds of it."""
        held = self._end - self._start
        if held < LENGTH.size:
            self._scratch[:held] = self._scratch[self._start : self._end]
            self._start, self._end = 0, held
            return
        (length,) = LENGTH.unpack_from(self._scratch, self._start)
        if length > self.max_frame_bytes:
            raise TcprosError(f"frame of {length} bytes, over the limit of {self.max_frame_bytes}")
        self._start += LENGTH.size
        self._length = length
        self._body = bytearray(min(length, max(FIRST_STEP_BYTES, 2 * self._last_length)))
        taken = min(length, self._end - self._start)
        self._body[:taken] = self._scratch[self._start : self._start + taken]
        self._filled = taken
        self._start += taken
