import io
from pathlib import Path

import pytest

from services.toolbox.streams import Printed, PrintError


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
