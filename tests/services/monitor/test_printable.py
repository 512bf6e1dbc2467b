import pytest

from services.monitor.printable import printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Gabelstapler, grün", "Gabelstapler, grün"),
        (
            "\x1b[2Jbox\r\nr1: online",
            "\N{REPLACEMENT CHARACTER}[2Jbox\N{REPLACEMENT CHARACTER}\N{REPLACEMENT CHARACTER}r1: online",
        ),
        ("\N{RIGHT-TO-LEFT OVERRIDE}\N{LINE SEPARATOR}\x9b", "\N{REPLACEMENT CHARACTER}" * 3),
        ("", ""),
    ],
)
def test_what_could_forge_a_line_is_replaced(text: str, shown: str) -> None:
    assert printable(text) == shown
