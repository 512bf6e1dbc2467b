"""A memory budget shared by several holders: the largest holder makes room. Pure."""

from typing import Final, Protocol

MIB: Final = 1024 * 1024
MEMORY_BYTES: Final = 512 * MIB

CROWDED: Final = "no room for more"


class Holder(Protocol):
    """A holder of memory under the budget."""

    def shed(self) -> None:
        """Release some of the data, oldest first, and note it in the budget."""


class MemoryBudget:
    """A limit in bytes for all of its holders together."""

    def __init__(self, most_bytes: int = MEMORY_BYTES) -> None:
        self._most = most_bytes
        self._held: dict[Holder, int] = {}
        self.taken = 0

    def hold(self, holder: Holder, size: int) -> None:
        """Note the number of bytes of a holder; one with 0 bytes is removed."""
        self.taken += size - self._held.pop(holder, 0)
        if size:
            self._held[holder] = size

    def settle(self) -> None:
        """Make the largest holders shed until all data fits."""
        while self.taken > self._most:
            max(self._held, key=self._held.__getitem__).shed()
