"""The console command."""

import os
import signal
import sys
from typing import NoReturn

from services.toolbox import streams


def console() -> NoReturn:
    """Run the command line of this process and leave it. Told to stop before there is anything to end, it is left."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave_at_once)
    streams.prepare()
    # What the command line needs takes a while to import.
    from services.toolbox import command_line, process  # noqa: PLC0415

    process.leave(command_line.main(sys.argv[1:]))


def _leave_at_once(_number: int, _frame: object) -> NoReturn:
    os._exit(0)


if __name__ == "__main__":
    console()
