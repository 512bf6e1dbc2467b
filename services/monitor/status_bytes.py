"""Bounds the bytes of the statuses that are kept: of many robots', or workers', together. Pure."""

from collections.abc import Hashable
from typing import Final, Generic, TypeVar

from schemas.errors import SchemaError

MAX_STATUS_BYTES: Final = 16 << 20
"""Most bytes of statuses on the wire that are kept of each kind: 8 KiB of 2,000 senders. In memory they take up to ten
times as much."""

USUAL_BYTES: Final = 8 << 10
"""Size of a status for which others leave in any case: small ones of many invented names keep nobody out."""

K = TypeVar("K", bound=Hashable)


class StatusBytes(Generic[K]):
    """The bytes of each kept status; those heard of longest ago leave where there are too many."""

    def __init__(self, most: int = MAX_STATUS_BYTES, usual: int = USUAL_BYTES) -> None:
        self._most, self._usual = most, usual
        self._bytes: dict[K, int] = {}
        self._total = 0

    def take(self, name: K, size: int) -> list[K]:
        """Note the bytes of a sender's newest status, which replaces the one before; return who leaves for it.

        Raises:
            SchemaError: there are too many, and this is above its share and the usual size; the one before is kept.
        """
        over = self._total - self._bytes.get(name, 0) + size - self._most
        share = self._most // max(1, len(self._bytes) + (name not in self._bytes))
        if over > 0 and size > min(self._most, max(share, self._usual)):
            raise SchemaError(f"a status of {size} bytes, where all statuses together may have {self._most}")
        leaving = []
        for other, held in self._bytes.items():
            if over <= 0:
                break
            if other != name:
                leaving.append(other)
                over -= held
        for each in (*leaving, name):
            self.drop(each)
        self._bytes[name] = size  # the last, as it was heard of latest
        self._total += size
        return leaving

    def drop(self, name: K) -> None:
        """Forget a sender."""
        self._total -= self._bytes.pop(name, 0)
