"""A clock of the fleet's own that can be stepped: Debian's libfaketime, asked at every reading of the system clock."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

LIBRARIES: Final = Path("/usr/lib")
PATTERN: Final = "*/faketime/libfaketimeMT.so.1"


def library() -> Path | None:
    """Return libfaketime; None where it is not installed."""
    return next(LIBRARIES.glob(PATTERN), None)


def environment(library: Path, file: Path) -> Mapping[str, str]:
    """Return the environment of processes whose clock a file moves; the monotonic clock stays as it is."""
    return {
        "LD_PRELOAD": str(library),
        "FAKETIME_TIMESTAMP_FILE": str(file),
        "FAKETIME_NO_CACHE": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }


def step(file: Path, seconds: int) -> None:
    """Set the clock to so many seconds before or after the machine's, for all processes at once."""
    new = file.with_suffix(".new")
    new.write_text(f"{seconds:+d}\n", encoding="ascii")
    new.replace(file)
