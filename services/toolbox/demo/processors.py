"""How busy the processors were that the demo may use: where they are too slow, ages say nothing of fleetsight."""

import os
import resource
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

TOO_BUSY: Final = 0.9
"""Share of the processors' time above which work waits for its turn."""

_STAT: Final = Path("/proc/stat")
_TIMES: Final = slice(1, 9)
"""Of a line: user, nice, system, idle, iowait, irq, softirq and steal, in ticks; the first line is of all
processors."""
_IDLE: Final = (3, 4)

_OWN_GROUPS: Final = Path("/proc/self/cgroup")
_GROUPS: Final = Path("/sys/fs/cgroup")
"""Where control groups are: one tree in version 2, one for each kind of resource in version 1."""


@dataclass(frozen=True, slots=True)
class ProcessorUse:
    """count: processors that this process may use, a fraction where a container's quota says so.

    busy: the share of all their time that anything took, or of the quota that the container did if that is more. own:
    the share that the demo's processes took.
    """

    count: float
    busy: float
    own: float

    def __str__(self) -> str:
        used = f"{self.count:g} processors, {self.busy:.0%} busy, {self.own:.0%} with the demo"
        if self.busy < TOO_BUSY:
            return used
        cure = "close other programs, or ask for less with --robots and --hz"
        return f"too slow for this ({used}), which raises ages and drops: {cure}"


class ProcessorClock:
    """Measures CPU use from its creation on."""

    def __init__(self) -> None:
        self._began = _times()
        self._began_s = time.monotonic()
        self._own_s = _own_s()
        self._quota = _quota()

    def use(self) -> ProcessorUse | None:
        """Return the CPU use since creation; None where the system does not tell.

        Processes that this one started count as its own once they have ended.
        """
        now, began = _times(), self._began
        if now is None or began is None or (total := now[0] - began[0]) <= 0:
            return None
        count, busy, own_s = len(os.sched_getaffinity(0)), (now[1] - began[1]) / total, _own_s() - self._own_s
        quota, elapsed_s = _quota(), time.monotonic() - self._began_s
        if quota is not None and self._quota is not None and quota.count < count:
            allowed_s = quota.count * elapsed_s
            busy = min(1.0, max(busy, (quota.used_s - self._quota.used_s) / allowed_s))
            return ProcessorUse(quota.count, busy, min(1.0, own_s / allowed_s))
        return ProcessorUse(count, busy, min(1.0, own_s * os.sysconf("SC_CLK_TCK") / total))


def _times() -> tuple[int, int] | None:
    """Return the ticks so far of all processors that this process may use, and those in which they were busy."""
    try:
        lines = [line.split() for line in _STAT.read_text(encoding="ascii").splitlines() if line.startswith("cpu")]
        allowed = os.sched_getaffinity(0)
        of_each = [line for line in lines[1:] if int(line[0].removeprefix("cpu")) in allowed]
        chosen = lines[:1] if len(allowed) >= (os.cpu_count() or 1) else of_each
        times = [[int(each) for each in line[_TIMES]] for line in chosen]
    except (OSError, ValueError):
        return None
    idle = sum(ticks[place] for ticks in times for place in _IDLE if place < len(ticks))
    return sum(map(sum, times)), sum(map(sum, times)) - idle


@dataclass(frozen=True, slots=True)
class _Quota:
    """count: processors whose time a control group may take. used_s: seconds of that time that it has taken so far."""

    count: float
    used_s: float


def _quota() -> _Quota | None:
    """Return the tightest quota that this process is under; None without one."""
    quotas = [quota for folder in _own_folders() if (quota := _quota_of(folder)) is not None]
    return min(quotas, key=lambda quota: quota.count, default=None)


def _own_folders() -> Iterator[Path]:
    """Return the folders of this process's control groups that limit processors, and of all that these are in."""
    try:
        lines = _OWN_GROUPS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return
    for _, kinds, name in (line.split(":", 2) for line in lines):
        if kinds and "cpu" not in kinds.split(","):
            continue
        tree = _GROUPS / "cpu" if kinds else _GROUPS
        own = tree / name.lstrip("/")
        yield from (each for each in (own, *own.parents) if each.is_relative_to(tree))


def _quota_of(folder: Path) -> _Quota | None:
    """Return a group's quota, as version 2 or 1 says it; None if it has none, or none that can be read."""
    try:
        if (folder / "cpu.max").exists():
            limit, of = (folder / "cpu.max").read_text(encoding="ascii").split()
            usage = dict(line.split() for line in (folder / "cpu.stat").read_text(encoding="ascii").splitlines())
            return None if limit == "max" else _Quota(int(limit) / int(of), int(usage["usage_usec"]) / 1e6)
        most, period, used = (
            int((folder / name).read_text(encoding="ascii"))
            for name in ("cpu.cfs_quota_us", "cpu.cfs_period_us", "cpuacct.usage")
        )
    except (OSError, ValueError, LookupError):
        return None
    return _Quota(most / period, used / 1e9) if most > 0 else None


def _own_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)
