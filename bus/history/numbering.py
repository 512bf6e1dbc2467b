"""Numbers of kept messages, as attachments, and keys of the caches that keep them."""

import struct
from typing import Final, NamedTuple

import zenoh

CACHE: Final = "/@adv/pub/"
"""Separates a publisher's key from its session and its id there in the key of its cache, as with Zenoh's own caches."""

_STAMP: Final = struct.Struct(">BIQH")
_MARK: Final = 0xF5
"""First byte of our attachments."""


def stamp(publisher: int, number: int) -> bytes:
    """Return the attachment that numbers a message.

    publisher: a 32-bit id, unique among those of its key.
    """
    return _STAMP.pack(_MARK, publisher, number, 0)


class Stamp(NamedTuple):
    """Publisher and number as in `stamp`. again: an earlier release sent it on a new session, too; its cache has it."""

    publisher: int | str
    number: int
    again: bool = False


def stamp_of(sample: zenoh.Sample) -> Stamp | None:
    """Return a sample's number, or None if it has none. Messages of other programs have Zenoh's own numbers."""
    ours = _unpacked(sample)
    if ours is not None:
        return Stamp(ours[0], ours[1], ours[2] > 0)
    info = sample.source_info
    return None if info is None else Stamp(place_of(info.source_id), info.source_sn)


def is_sent_again(sample: zenoh.Sample) -> bool:
    """Return `Stamp.again`, for those who need no number."""
    ours = _unpacked(sample)
    return ours is not None and ours[2] > 0


def _unpacked(sample: zenoh.Sample) -> tuple[int, int, int] | None:
    """Return publisher, number and, in messages that were sent again, how new they are; None without our attachment."""
    attachment = sample.attachment
    if attachment is None or len(attachment) != _STAMP.size:
        return None
    mark, publisher, number, newness = _STAMP.unpack(attachment.to_bytes())
    return (publisher, number, newness) if mark == _MARK else None


def place_of(publisher: zenoh.EntityGlobalId) -> str:
    """Return a publisher's session and entity id as they stand in the keys of Zenoh's own caches."""
    return f"{publisher.zid!s}/{publisher.eid}"


def cache_key(key: str, session: str, publisher: int) -> str:
    """Return the key of a publisher's cache and of the token that shows it."""
    return f"{key}{CACHE}{session}/{publisher}/_"


def owner_of(cache: str) -> tuple[str, str]:
    """Return the key that a cache belongs to, and the place of its publisher."""
    key, _, place = cache.rpartition(CACHE)
    return key, "/".join(place.split("/")[:2])


def is_of(cache: str, publisher: int | str) -> bool:
    """Return whether a cache is that of a publisher as in `stamp_of`."""
    _, place = owner_of(cache)
    return place == publisher if isinstance(publisher, str) else place.rpartition("/")[2] == str(publisher)
