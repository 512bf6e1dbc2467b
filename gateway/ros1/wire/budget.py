"""What the messages hold together that several connections are in the middle of."""

from __future__ import annotations

from gateway.ros1.errors import TcprosError


class FrameBudget:
    """At most `max_bytes` of large frames that are not whole; whoever comes when it is used up is refused."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self.held_bytes = 0

    def has(self, count: int) -> bool:
        """Return whether so much more may be held."""
        return self.held_bytes + count <= self._max_bytes

    def take(self, count: int) -> None:
        """Hold more, or less.

        Raises:
            TcprosError: others hold too much for that.

        """
        if count > 0 and not self.has(count):
            raise TcprosError(f"unfinished messages hold {self.held_bytes} bytes, {count} more are over the limit")
        self.held_bytes += count
