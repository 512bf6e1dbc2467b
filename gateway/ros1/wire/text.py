"""What peers say, as it may stand in an error."""

from __future__ import annotations

MAX_CHARACTERS = 500


def one_line(text: str) -> str:
    """Return a peer's text without what could write a line of a log of its own, cut where it is long."""
    words = " ".join(text[:MAX_CHARACTERS].split())
    return "".join(character if character.isprintable() else "?" for character in words)
