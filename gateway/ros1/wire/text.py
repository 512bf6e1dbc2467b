"""Texts from peers, bounded and safe to show in an error."""

from __future__ import annotations

from gateway.ros1.errors import MessageError

MAX_CHARACTERS = 500


def one_line(text: str) -> str:
    """Return a peer's text on one line, without control characters, truncated if long."""
    words = " ".join(text[:MAX_CHARACTERS].split())
    return "".join(character if character.isprintable() else "?" for character in words)


MAX_TEXT_BYTES = 1024


def read_text(type_name: str, view: memoryview, at: int, length: int) -> tuple[str, int]:
    """Return a message's text of `length` bytes, and its end offset; bytes that are not UTF-8 become U+FFFD.

    Raises:
        MessageError: it is too long, or cut off.

    """
    end = at + length
    if length > MAX_TEXT_BYTES or end > len(view):
        raise MessageError(f"{type_name} with a text of {length} bytes")
    return str(view[at:end], "utf-8", "replace"), end


def encode_text(type_name: str, text: str) -> bytes:
    """Return the bytes of a message's text.

    Raises:
        MessageError: it is too long.
        UnicodeEncodeError: it is no text.

    """
    encoded = text.encode()
    if len(encoded) > MAX_TEXT_BYTES:
        raise MessageError(f"{type_name} with a text of {len(encoded)} bytes")
    return encoded
