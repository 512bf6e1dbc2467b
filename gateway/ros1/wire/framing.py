"""Length-prefixed frames, received with one copy at most.

Small frames are cut out of a scratch buffer that takes many of them in one read. A frame larger than what the scratch
buffer holds gets a buffer of its own, into which the rest of it is received directly. Announcing a length costs no
memory: that buffer grows with what arrives, and is whole from the start where the previous frame was as large. Where
the last two were of one size, as a camera's are, it is there before the length is, which saves a read.
"""

from __future__ import annotations

from gateway.ros1.errors import TcprosError, TooLargeError
from gateway.ros1.wire.header import LENGTH


class FrameBudget:
    """Budget of `max_bytes` for large unfinished frames; when it is used up, further frames are refused."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self.held_bytes = 0

    def has(self, count: int) -> bool:
        """Return whether the budget has room for so many bytes."""
        return self.held_bytes + count <= self._max_bytes

    def take(self, count: int) -> None:
        """Add bytes to those held; a negative number releases them.

        Raises:
            TcprosError: others hold too much for that.

        """
        if count > 0 and not self.has(count):
            raise TcprosError(f"unfinished messages hold {self.held_bytes} bytes, {count} more are over the limit")
        self.held_bytes += count


SCRATCH_BYTES = 16 << 10
FIRST_STEP_BYTES = 64 << 10


class FrameReceiver:
    """Cuts a byte stream into frames of at most `max_frame_bytes`; the cap is checked before a frame is allocated.

    of_messages: a frame over the cap is a message that is too large, rather than no TCPROS.

    Holds, besides the scratch buffer, at most FIRST_STEP_BYTES or twice what arrived of this frame or of the last one;
    more than FIRST_STEP_BYTES only where the budget, which it may share with others, has them.
    """

    def __init__(self, max_frame_bytes: int, budget: FrameBudget | None = None) -> None:
        self.max_frame_bytes = max_frame_bytes
        self.of_messages = False
        self._small = memoryview(bytearray(SCRATCH_BYTES))
        self._scratch = self._small
        self._start = 0
        self._end = 0
        self._body: memoryview | None = None
        self._length = 0
        self._filled = 0
        self._last_length = 0
        self._is_steady = False
        self._whole_frames = 0
        self._budget = budget
        self._taken = 0

    def get_buffer(self) -> memoryview:
        """Return the buffer for the next received bytes; never empty once `next_frame` has returned None."""
        if self._body is not None:
            return self._body[self._filled :]
        if self._start == self._end:
            self._start = self._end = 0
            if self._is_steady:
                self._expect()
        return self._scratch[self._end :]

    def buffer_updated(self, count: int) -> None:
        """Note that `count` bytes were written to the start of the last `get_buffer`."""
        if self._body is not None:
            self._filled += count
        else:
            self._end += count

    @property
    def frame_under_way(self) -> int | None:
        """The number of the frame that is partly received."""
        return None if self._body is None else self._whole_frames

    def close(self) -> None:
        """Release the unfinished frame; nothing can be received after that."""
        self._body, self._scratch, self._is_steady = None, self._small, False
        self._take_from_budget(0)

    def next_frame(self) -> memoryview | None:
        """Return the next complete frame, in memory of its own, or None if more bytes are needed.

        Raises:
            TcprosError: the frame's length is over the cap, or the budget is used up.
            TooLargeError: it is over the cap, and the frames are messages.

        """
        if self._body is None and self._start < self._end:
            self._begin_body()
        body = self._body
        if body is None or self._filled < len(body):
            return None
        if self._filled < self._length:
            self._body = self._buffer(min(self._length, 2 * self._filled))
            self._body[: self._filled] = body
            return None
        self._is_steady = self._last_length == self._length > SCRATCH_BYTES
        self._body, self._filled, self._last_length = None, 0, self._length
        self._whole_frames += 1
        self._take_from_budget(0)
        return body

    def _expect(self) -> None:
        """Receive the next frame and its length in their final place if it is like the last two.

        An expected frame leaves room in the budget for the largest one that may really be under way.
        """
        size = LENGTH.size + self._last_length
        if self._budget is None or self._budget.has(size - self._taken + self.max_frame_bytes):
            self._scratch = self._buffer(size)

    def _begin_body(self) -> None:
        """Start the next frame with its bytes from the scratch buffer."""
        held = self._end - self._start
        if held < LENGTH.size:
            self._small[:held] = self._scratch[self._start : self._end]
            self._scratch, self._start, self._end = self._small, 0, held
            self._take_from_budget(0)
            return
        (self._length,) = LENGTH.unpack_from(self._scratch, self._start)
        if self._length > self.max_frame_bytes:
            if self.of_messages:
                raise TooLargeError(self._length, self.max_frame_bytes)
            raise TcprosError(f"frame of {self._length} bytes, over the limit of {self.max_frame_bytes}")
        self._start += LENGTH.size
        if self._scratch is not self._small and len(self._scratch) - self._start == self._length:
            self._body, self._filled = self._scratch[self._start :], self._end - self._start
        else:
            self._filled = min(self._length, self._end - self._start)
            self._body = self._buffer(min(self._length, max(FIRST_STEP_BYTES, 2 * self._last_length, self._filled)))
            self._body[: self._filled] = self._scratch[self._start : self._start + self._filled]
        self._start += self._filled
        if self._start == self._end:
            self._scratch = self._small

    def _buffer(self, size: int) -> memoryview:
        """Return a zeroed bytearray, which the bus passes on without a copy."""
        self._take_from_budget(size if size > FIRST_STEP_BYTES else 0)
        return memoryview(bytearray(size))

    def _take_from_budget(self, count: int) -> None:
        if self._budget is not None and count != self._taken:
            self._budget.take(count - self._taken)
            self._taken = count
