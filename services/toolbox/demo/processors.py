"""Measures CPU load during the demo: on a machine that is too slow, ages say nothing of fleetsight."""

import os
import resource
from dataclasses import dataclass
from pathlib import Path
from typing import Final

TOO_BUSY: Final = 0.9
"""Share of the processors' time above which work waits for its turn."""

_STAT: Final = Path("/proc/stat")
_TIMES: Final = slice(1, 9)
"""Fields of the first line: user, nice, system, idle, iowait, irq, softirq and steal, in ticks of all processors."""
_IDLE: Final = (3, 4)


@dataclass(frozen=True, slots=True)
class ProcessorUse:
    """CPU use. count: processors. busy, own: shares of their time in use, and in use by the demo."""

    count: int
    busy: float
    own: float

    def __str__(self) -> str:
        used = f"{self.count} processors, {self.busy:.0%} busy, {self.own:.0%} with the demo"
        if self.busy < TOO_BUSY:
            return used
        cure = "close other programs, or ask for less with --robots and --hz"
        return f"too slow for this ({used}), which raises ages and drops: {cure}"


class ProcessorClock:
    """Measures CPU use from its creation on."""

    def __init__(self) -> None:
        self._began = _times()
        self._own_s = _own_s()

    def use(self) -> ProcessorUse | None:
        """Return the CPU use since creation; None where the system does not tell.

        Processes that this one started count as its own once they have ended.
        """
        now, began = _times(), self._began
        if now is None or began is None or (total := now[0] - began[0]) <= 0:
            return None
        own = (_own_s() - self._own_s) * os.sysconf("SC_CLK_TCK") / total
        return ProcessorUse(os.cpu_count() or 1, (now[1] - began[1]) / total, min(1.0, own))


def _times() -> tuple[int, int] | None:
    """Return the ticks of all processors so far, and their busy ticks."""
    try:
        ticks = [int(each) for each in _STAT.read_text(encoding="ascii").split("\n", 1)[0].split()[_TIMES]]
    except (OSError, ValueError):
        return None
    return sum(ticks), sum(ticks) - sum(ticks[place] for place in _IDLE if place < len(ticks))


def _own_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)
