"""What became of a stream's messages on their way through its outlet. Pure."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self


@dataclass(frozen=True, slots=True)
class OutletCounts:
    """Drops by reason, payload bytes sent, and how the last frame was compressed: empty for what is no frame."""

    dropped: Mapping[str, int] = field(default_factory=dict)
    bytes: int = 0
    compression: str = ""

    def __add__(self, other: Self) -> "OutletCounts":
        """Return what became of the messages of both."""
        return OutletCounts(
            Counter(self.dropped) + Counter(other.dropped),
            self.bytes + other.bytes,
            other.compression or self.compression,
        )
