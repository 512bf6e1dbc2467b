"""A system clock that can be stepped for some processes alone, all of them at once: a library that they load first."""

import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

SOURCE: Final = Path(__file__).with_suffix(".c")
FILE: Final = "clock"


def compiler() -> str | None:
    """Return the C compiler's name; None where there is none."""
    return next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)


def make(folder: Path) -> Mapping[str, str]:
    """Make a clock that shows the machine's time; return the environment of processes that have it."""
    library = folder / "clock.so"
    made_by = compiler()
    if made_by is None:
        raise FileNotFoundError("no C compiler")
    subprocess.run([made_by, "-shared", "-fPIC", "-O2", "-o", str(library), str(SOURCE)], check=True)
    step(folder, 0)
    return {"LD_PRELOAD": str(library), "CHAOS_CLOCK": str(folder / FILE)}


def step(folder: Path, ahead_ns: int) -> None:
    """Set the clock to so much ahead of the machine's, or behind."""
    file = folder / FILE
    file.touch()
    with file.open("r+b", buffering=0) as opened:  # the same file: processes have it in memory
        opened.write(ahead_ns.to_bytes(8, sys.byteorder, signed=True))
