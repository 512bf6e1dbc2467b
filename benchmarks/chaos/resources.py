"""Memory and open files of the fleet's processes, before and after a fault."""

from collections.abc import Mapping
from dataclasses import dataclass

import psutil


@dataclass(frozen=True, slots=True)
class Use:
    """What one process takes: resident bytes and open files."""

    pid: int
    rss: int
    files: int


def uses(pids: Mapping[str, int]) -> dict[str, Use]:
    """Return what each process takes that runs, by role."""
    found = {}
    for role, pid in pids.items():
        try:
            process = psutil.Process(pid)
            found[role] = Use(pid, process.memory_info().rss, process.num_fds())
        except psutil.Error:
            continue
    return found


def growth(before: Mapping[str, Use], after: Mapping[str, Use]) -> dict[str, tuple[float, int]]:
    """Return by role how many MiB and files more each process takes that is still the same one."""
    return {
        role: (round((now.rss - then.rss) / 2**20, 1), now.files - then.files)
        for role, now in after.items()
        if (then := before.get(role)) is not None and then.pid == now.pid
    }
