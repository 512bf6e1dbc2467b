"""What became of a stream's messages on their way through its outlet. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class OutletCounts:
    """Drops by reason, payload bytes sent, and how the last frame was compressed: empty for what is no frame."""

    dropped: Mapping[str, int] = field(default_factory=dict)
    bytes: int = 0
    compression: str = ""
