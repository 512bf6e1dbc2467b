from __future__ import annotations

import pytest

from gateway.ros1.errors import MessageError
from gateway.ros1.wire.text import MAX_TEXT_BYTES, encode_text, read_text

NAME = "a/B"


@pytest.mark.parametrize("text", ["", "größer", "x" * MAX_TEXT_BYTES])
def test_what_is_encoded_is_read(text: str) -> None:
    encoded = encode_text(NAME, text)
    assert read_text(NAME, memoryview(b"before" + encoded + b"after"), 6, len(encoded)) == (text, 6 + len(encoded))


def test_a_text_that_is_too_long_or_cut_off() -> None:
    longer = "x" * (MAX_TEXT_BYTES + 1)
    with pytest.raises(MessageError, match=f"a/B with a text of {MAX_TEXT_BYTES + 1} bytes"):
        encode_text(NAME, longer)
    with pytest.raises(MessageError, match=f"a/B with a text of {MAX_TEXT_BYTES + 1} bytes"):
        read_text(NAME, memoryview(longer.encode()), 0, len(longer))
    with pytest.raises(MessageError, match="a/B with a text of 3 bytes"):
        read_text(NAME, memoryview(b"abc"), 1, 3)


def test_bytes_that_are_not_utf8_are_replaced() -> None:
    assert read_text(NAME, memoryview(b"Gr\xfc\xdfe."), 0, 5) == ("Gr\ufffd\ufffde", 5)


def test_what_cannot_be_encoded() -> None:
    with pytest.raises(UnicodeEncodeError):
        encode_text(NAME, "\ud800")
