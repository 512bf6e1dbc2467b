"""Which of a robot's programs go first."""

import os
from contextlib import suppress


def give_way() -> None:
    """Have this thread, and those that it starts from now on, interrupt no program when they wake up (SCHED_BATCH).

    They wait for a processor that is idle, or until another program's turn is over, which takes milliseconds. That also
    keeps the threads of a gateway from interrupting each other: sending an image then takes fewer turns. What has been
    started under another policy than the usual one keeps it.
    """
    if os.sched_getscheduler(0) == os.SCHED_OTHER:
        with suppress(PermissionError):  # a sandbox that allows none is no reason not to start
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
