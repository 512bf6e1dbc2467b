"""Which publisher sent a sample, and as which of its messages: as Zenoh's advanced publishers (1.10) say it."""

import re
from typing import Final

import zenoh

CACHE: Final = "/@adv/pub/"
"""In the key of an advanced publisher's cache and presence, between its own key and its session and number."""

_SOURCE: Final = re.compile(r".*/@adv/pub/([0-9a-f]{1,32}/\d{1,10})(?:/.*)?")
_KEPT: Final = re.compile(rb"kept ([0-9a-f]{1,32}/\d{1,10}) (\d{1,10})")
_NUMBERS: Final = 1 << 32


def source_of(publisher: zenoh.EntityGlobalId) -> str:
    """Return a publisher's name among all."""
    return f"{publisher.zid!s}/{publisher.eid}"


def source_of_cache(cache: str) -> str | None:
    """Return the name of the publisher whose cache has a key, if its messages have numbers."""
    found = _SOURCE.fullmatch(cache)
    return found and found[1]


def origin_text(source: str, number: int) -> bytes:
    """Return what is attached to a message that a publisher takes to its next session: what it was there before."""
    return f"kept {source} {number}".encode()


def origin_of(sample: zenoh.Sample) -> tuple[str, int] | None:
    """Return the publisher and number that a message had on an earlier session, if it comes from there."""
    if sample.attachment is None or (kept := _KEPT.fullmatch(sample.attachment.to_bytes())) is None:
        return None
    number = int(kept[2])
    return (kept[1].decode(), number) if number < _NUMBERS else None
