import fcntl
import io
import os
import struct
import subprocess
import sys
import termios
from contextlib import suppress
from pathlib import Path
from typing import Final

import pytest

from services.toolbox.stdio import Printed, PrintError

WIDTH: Final = 72


def test_what_cannot_be_printed_is_told_from_what_else_fails() -> None:
    with Path("/dev/full").open("wb", buffering=0) as full:
        printed = Printed(full, "utf-8", write_through=True)
        with pytest.raises(PrintError, match="No space left on device"):
            printed.write("too much")
        printed.detach()


def test_what_is_printed_is_written() -> None:
    written = io.BytesIO()
    printed = Printed(written, "utf-8", write_through=True)
    assert printed.write("grün\n") == 5
    assert written.getvalue() == "grün\n".encode()


def test_help_is_as_wide_as_the_terminal() -> None:
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, WIDTH, 0, 0))
    variables = {name: value for name, value in os.environ.items() if name not in {"COLUMNS", "LINES"}}
    command = [sys.executable, "-m", "services.toolbox", "detect", "--help"]
    with subprocess.Popen(command, stdout=theirs, env=variables) as child, os.fdopen(ours, "rb") as terminal:
        os.close(theirs)
        printed = b""
        with suppress(OSError):  # the end, where a terminal is
            while part := terminal.read1():
                printed += part
    assert child.returncode == 0
    assert WIDTH - 10 < max(map(len, printed.decode().splitlines())) <= WIDTH
