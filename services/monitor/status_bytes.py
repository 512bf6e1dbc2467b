"""Bounds the bytes of the statuses that are kept: of many robots', or workers', together. Pure."""

from collections.abc import Hashable
from typing import Final, Generic, TypeVar

from schemas.errors import SchemaError

MAX_STATUS_BYTES: Final = 24 << 20
"""Most bytes of statuses on the wire that are kept of each kind; in memory they take several times as much."""

K = TypeVar("K", bound=Hashable)


class StatusBytes(Generic[K]):
    """The bytes of each kept status. Where there are too many, those above their fair share are left out."""

    def __init__(self, most: int = MAX_STATUS_BYTES) -> None:
        self._most = most
        self._bytes: dict[K, int] = {}
        self._total = 0

    def take(self, name: K, size: int) -> None:
        """Note the bytes of a sender's newest status, which replaces the one before.

        Raises:
            SchemaError: there are too many, and this has more than its share; the one before is kept.
        """
        before = self._bytes.get(name, 0)
        share = self._most // max(1, len(self._bytes) + (name not in self._bytes))
        if self._total - before + size > self._most and size > share:
            raise SchemaError(f"a status of {size} bytes, where all statuses together may have {self._most}")
        self._bytes[name] = size
        self._total += size - before

    def drop(self, name: K) -> None:
        """Forget a sender."""
        self._total -= self._bytes.pop(name, 0)
