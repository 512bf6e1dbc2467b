"""Arrays kept in memory, compressed without loss, as many as fit. Pure."""

import sys
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

LEVEL: Final = 1


@dataclass(frozen=True, slots=True)
class _Kept:
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    data: bytes


class Store:
    """Keeps arrays under their keys up to `limit` bytes in all; what would go beyond is not kept.

    First come, first kept: of a loop that does not fit a part is kept, where keeping the newest would keep nothing.
    """

    def __init__(self, limit: int) -> None:
        self.size = 0
        self.refused = 0
        self._limit = limit
        self._kept: dict[Hashable, _Kept] = {}

    def get(self, key: Hashable) -> NDArray[Any] | None:
        """Return a kept array, not writable; None when it is not kept."""
        kept = self._kept.get(key)
        return None if kept is None else np.frombuffer(zstd.decompress(kept.data), kept.dtype).reshape(kept.shape)

    def put(self, key: Hashable, array: NDArray[Any]) -> None:
        """Keep an array under a key that is not in use, if there is room."""
        data = zstd.compress(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data, LEVEL)
        if self.size + len(data) > self._limit:
            self.refused += 1
            return
        self._kept[key] = _Kept(array.shape, array.dtype, data)
        self.size += len(data)
