"""How late frames come, by two clocks of which nobody knows how they lie to each other. Pure."""

from typing import Final

BUCKET_NS: Final = 2_000_000_000
"""After twice as long a clock that was set is believed."""


class Lateness:
    """Follows one sender: a frame is as late as it took longer, by the two clocks, than the quickest one lately."""

    def __init__(self) -> None:
        self._since_ns = 0
        self._quickest_ns: int | None = None
        self._before_ns: int | None = None

    def late_ns(self, sent_ns: int, received_ns: int) -> int:
        """Return by how much a frame is late that was sent at a time of their clock and received at one of ours."""
        took_ns = received_ns - sent_ns
        if self._quickest_ns is None:
            self._since_ns, self._quickest_ns = received_ns, took_ns
        elif not 0 <= received_ns - self._since_ns < BUCKET_NS:
            self._since_ns, self._before_ns, self._quickest_ns = received_ns, self._quickest_ns, took_ns
        self._quickest_ns = min(self._quickest_ns, took_ns)
        return took_ns - min(self._quickest_ns, self._quickest_ns if self._before_ns is None else self._before_ns)
