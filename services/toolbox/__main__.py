"""The console command."""

import signal
import sys
from typing import NoReturn

from services.toolbox import streams


def console() -> NoReturn:
    """Run the command line of this process and leave it. Ctrl-C before there is anything to end leaves no stack."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    streams.prepare()
    # What the command line needs takes a while to import.
    from services.toolbox import command_line, process  # noqa: PLC0415

    process.leave(command_line.main(sys.argv[1:]))


if __name__ == "__main__":
    console()
