"""Which publisher sent a sample, and as which of its messages.

A publisher's own numbers go on over its sessions; Zenoh's (1.10), which its advanced publishers have too, do not.
"""

import struct
from typing import Final

import zenoh

CACHE: Final = "/@adv/pub/"
"""In the key of an advanced publisher's cache and presence, between its own key and its session and number there."""

_STAMP: Final = struct.Struct(">BIQH")
_MARK: Final = 0xF5
"""What ours begin with."""

MOST_KEPT: Final = (1 << 16) - 1
"""As many as a publisher can keep."""


def stamp(publisher: int, number: int, newness: int) -> bytes:
    """Return what is attached to a message.

    publisher: one of 32 bits that tells it from others of its key. newness: 0 where the message is sent for the first
    time; else, of those that are sent again since there is a new session, 1 for the newest, 2 for the one before.
    """
    return _STAMP.pack(_MARK, publisher, number, newness)


def stamp_of(sample: zenoh.Sample) -> tuple[int | str, int, int] | None:
    """Return publisher, number and newness, as `stamp` has them, or None for one that nobody numbered.

    Other programs' have those of Zenoh.
    """
    attachment = sample.attachment
    if attachment is not None and len(attachment) == _STAMP.size:
        mark, publisher, number, newness = _STAMP.unpack(attachment.to_bytes())
        if mark == _MARK:
            return publisher, number, newness
    info = sample.source_info
    return None if info is None else (place_of(info.source_id), info.source_sn, 0)


def is_sent_again(sample: zenoh.Sample) -> bool:
    """Return whether a sample was sent on an earlier session of its publisher, too."""
    stamped = None if sample.attachment is None else stamp_of(sample)
    return stamped is not None and stamped[2] > 0


def place_of(publisher: zenoh.EntityGlobalId) -> str:
    """Return a publisher's session and number there, as caches' keys have them."""
    return f"{publisher.zid!s}/{publisher.eid}"


def owner_of(cache: str) -> tuple[str, str]:
    """Return the key whose messages a cache has, and the place of its publisher."""
    key, _, place = cache.rpartition(CACHE)
    return key, "/".join(place.split("/")[:2])
