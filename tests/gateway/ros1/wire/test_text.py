from __future__ import annotations

import pytest

from gateway.ros1.wire.text import MAX_CHARACTERS, one_line


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", ""),
        ("no a=b: größer", "no a=b: größer"),
        ("Traceback:\n  File\t'x'\r\n", "Traceback: File 'x'"),
        ("\x1b[31mred\x00\u202e", "?[31mred??"),
        ("x" * MAX_CHARACTERS, "x" * MAX_CHARACTERS),
        ("x" * (MAX_CHARACTERS + 1), "x" * MAX_CHARACTERS),
    ],
)
def test_one_line(text: str, line: str) -> None:
    assert one_line(text) == line
