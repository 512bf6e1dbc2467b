"""Which of a robot's programs go first."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress


@contextmanager
def giving_way() -> Iterator[None]:
    """Have this thread, and those that it starts, interrupt no program when they wake up (SCHED_BATCH).

    They wait for a processor that is idle, or until another program's turn is over, which takes milliseconds. That also
    keeps the threads of a gateway from interrupting each other: sending an image then takes fewer turns. What has been
    started under another policy than the usual one keeps it.
    """
    gives_way = os.sched_getscheduler(0) == os.SCHED_OTHER and _follow(os.SCHED_BATCH)
    try:
        yield
    finally:
        if gives_way:
            _follow(os.SCHED_OTHER)


def _follow(policy: int) -> bool:
    """Return whether this thread may follow a policy, and does; a sandbox that allows none harms nothing else."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, policy, os.sched_param(0))
        return True
    return False
