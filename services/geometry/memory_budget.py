"""Memory that several holders share: whoever holds most gives way. Pure."""

from typing import Final, Protocol

MIB: Final = 1024 * 1024
MEMORY_BYTES: Final = 512 * MIB

CROWDED: Final = "no room for more"


class Holder(Protocol):
    """Who keeps something."""

    def shed(self) -> None:
        """Let go of some of what is kept, the oldest first, and say so to the budget."""


class MemoryBudget:
    """So many bytes, for all of its holders together."""

    def __init__(self, most_bytes: int = MEMORY_BYTES) -> None:
        self._most = most_bytes
        self._held: dict[Holder, int] = {}
        self.taken = 0

    def hold(self, holder: Holder, size: int) -> None:
        """Note how many bytes somebody holds now; who holds none is forgotten."""
        self.taken += size - self._held.pop(holder, 0)
        if size:
            self._held[holder] = size

    def settle(self) -> None:
        """Have those that hold most shed until it all fits."""
        while self.taken > self._most:
            max(self._held, key=self._held.__getitem__).shed()
