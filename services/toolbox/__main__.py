"""The console command."""

import faulthandler
import os
import signal
import sys
from typing import Final, NoReturn

from services.toolbox import stdio

LASTING: Final = frozenset({"gateway", "detector", "distance", "cloud", "worldmodel", "monitor", "simulate", "demo"})
"""Commands that run until stopped. The others are interrupted, not done, when stopped; see `process.run`."""


def console() -> NoReturn:
    """Run the command line and exit. A signal before there is anything to stop exits at once."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave_at_once)
    stdio.prepare()
    faulthandler.enable()  # a crash in a library, or a watchdog that ends the process, leaves a stack of each thread
    # The command line takes a while to import.
    from services.toolbox import command_line, process  # noqa: PLC0415

    process.leave(command_line.main(sys.argv[1:]))


def _leave_at_once(number: int, _frame: object) -> NoReturn:
    os._exit(0 if LASTING.intersection(sys.argv[1:2]) else 128 + number)


if __name__ == "__main__":
    console()
