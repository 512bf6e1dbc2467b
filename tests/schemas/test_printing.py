import pytest

from schemas.printing import printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("", ""),
        ("box", "box"),
        ("caf\u00e9 \u2603 \U0001f4e6 it's 5\\6", "caf\u00e9 \u2603 \U0001f4e6 it's 5\\6"),
        ("\x1b[2J\x1b]0;title\x07", r"\x1b[2J\x1b]0;title\x07"),
        ("a\nb\rc\td\x00\x7f", r"a\nb\rc\td\x00\x7f"),
        ("\u202ereversed\u200b\u2028", r"\u202ereversed\u200b\u2028"),
        ("\x9b31m\ud800", r"\x9b31m\ud800"),
    ],
)
def test_what_is_not_printed_is_shown_as_its_escape(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert printable(text).isprintable()
