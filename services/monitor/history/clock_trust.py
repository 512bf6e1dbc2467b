"""Whether this machine's clock is plausible, judged by the last write to the history. Pure.

A clock that is far ahead would have all history forgotten at once, and file what is seen under a time to come.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from services.monitor.inventory.sighting import NS

DAY_NS: Final = 86_400 * NS

FAR_NS: Final = 7 * DAY_NS
"""Maximum distance of the clock from the last write, for instance since the monitor was off, to be trusted."""

CURE: Final = "set the clock, or, if it is right, run `fleetsight history trust-clock`"


@dataclass(frozen=True, slots=True)
class Doubt:
    """The clock showed `doubted_ns` when about `believed_ns` was expected; both are epoch nanoseconds."""

    believed_ns: int
    doubted_ns: int

    @property
    def is_behind(self) -> bool:
        """Whether the clock showed less than it should have."""
        return self.doubted_ns < self.believed_ns

    def __str__(self) -> str:
        """Say it in words."""
        days = abs(self.doubted_ns - self.believed_ns) / DAY_NS
        where = "behind" if self.is_behind else "ahead of"
        return (
            f"the clock of this machine is {days:.0f} days {where} the history, which was kept last at"
            f" {_moment(self.believed_ns)}: no old history is forgotten until both agree; {CURE}"
        )


@dataclass(frozen=True, slots=True)
class Correction:
    """Rows written at `from_ns` or later carry times of a clock that was this far ahead."""

    from_ns: int
    ahead_ns: int

    def corrected(self, at_ns: int) -> int:
        """Return a time, corrected by about as much as the clock was ahead."""
        return at_ns - self.ahead_ns if at_ns >= self.from_ns else at_ns


@dataclass(frozen=True, slots=True)
class _Reading:
    clock_ns: int
    steady_ns: int

    def at(self, steady_ns: int) -> int:
        """Return the time that the clock would show if nobody had set it."""
        return self.clock_ns + steady_ns - self.steady_ns


class ClockTrust:
    """Follows this machine's clock. steady_ns: of a clock that is never set and runs while the machine sleeps.

    doubt: why the clock is not trusted, None while it is.
    """

    def __init__(self, far_ns: int = FAR_NS) -> None:
        self.doubt: Doubt | None = None
        self._far_ns = far_ns
        self._believed: _Reading | None = None
        self._last: _Reading | None = None
        self._set_back_ns = 0

    def begin(self, kept_ns: int, doubt: Doubt | None, steady_ns: int) -> None:
        """Take the time of the last write, 0 if never, and why an earlier monitor doubted the clock.

        A monitor that has trusted its clock before keeps to that: the database may have been gone for long.
        """
        if self._believed is None and (kept_ns or doubt):
            self._believed = _Reading(kept_ns if doubt is None else doubt.believed_ns, steady_ns)
        self.doubt = self.doubt or doubt

    def advance(self, now_ns: int, steady_ns: int) -> Correction | None:
        """Take the clock's reading; return the correction once a clock that was far ahead is right again."""
        before, self._last = self._last, _Reading(now_ns, steady_ns)
        set_back_ns = 0 if before is None else before.at(steady_ns) - now_ns
        if set_back_ns > self._far_ns:
            self._set_back_ns = set_back_ns
        expected_ns = now_ns if self._believed is None else self._believed.at(steady_ns)
        if abs(now_ns - expected_ns) > self._far_ns:
            self.doubt = self.doubt or Doubt(expected_ns, now_ns)
            return None
        return self._believe()

    def trust(self) -> Correction | None:
        """Trust the clock, as an operator confirmed it; return as `advance` does.

        The clock that dated the stored history was ahead only if it has been set back since, by more than a little.
        """
        if self._last is None or self.doubt is None:
            return None
        doubt, set_back_ns, now_ns = self.doubt, self._set_back_ns, self._last.clock_ns
        correction = self._believe()
        if set_back_ns and doubt.is_behind:  # it was ahead from the first start on
            return Correction(now_ns + set_back_ns // 2, set_back_ns)
        return correction if set_back_ns or doubt.doubted_ns - now_ns > self._far_ns else None

    def _believe(self) -> Correction | None:
        doubt, self.doubt, self._believed = self.doubt, None, self._last
        set_back_ns, self._set_back_ns = self._set_back_ns, 0
        assert self._last is not None, "the clock was read"  # noqa: S101 - for the type
        if doubt is None or doubt.is_behind or self._last.clock_ns >= doubt.doubted_ns:
            return None
        ahead_ns = set_back_ns or doubt.doubted_ns - doubt.believed_ns  # the former is known, the latter about right
        return Correction(doubt.doubted_ns - ahead_ns // 2, ahead_ns)  # it was ahead before that was noticed


def _moment(at_ns: int) -> str:
    return datetime.fromtimestamp(at_ns / NS, UTC).strftime("%Y-%m-%d %H:%M UTC")
