"""The `fleetsight` command; `python -m fleetsight` is the same."""

import sys
from typing import NoReturn

from fleetsight import own_packages


def console() -> NoReturn:
    """Run the command line of this process and leave it."""
    try:
        own_packages.put_first(own_packages.ALL)
    except ImportError as error:
        sys.exit(f"fleetsight: {error}")
    from services.toolbox.__main__ import console as command_line  # noqa: PLC0415 - found by what is above

    command_line()


if __name__ == "__main__":
    console()
