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
    gives_way = _changed(os.SCHED_OTHER, os.SCHED_BATCH)
    try:
        yield
    finally:
        if gives_way:
            _changed(os.SCHED_BATCH, os.SCHED_OTHER)


def _changed(before: int, after: int) -> bool:
    """Change this thread's policy if it is `before`; return whether that was done. Some sandboxes know no policies."""
    with suppress(OSError):
        if os.sched_getscheduler(0) == before:
            os.sched_setscheduler(0, after, os.sched_param(0))
            return True
    return False
