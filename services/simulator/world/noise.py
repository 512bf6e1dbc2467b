"""Planes of noise that are made once, and the windows that each picture takes from them."""

from typing import Final, TypeVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

PLANE: Final = 1024
Value = TypeVar("Value", bound=np.generic)


def window(plane: NDArray[Value], height: int, width: int, rng: Generator) -> NDArray[Value]:
    """A copy of a random window of `plane` (PLANE, PLANE, ...), which goes on beyond its borders as it began."""
    top, left = int(rng.integers(0, PLANE)), int(rng.integers(0, PLANE))
    rows = np.take(plane, np.arange(top, top + height), axis=0, mode="wrap")
    return np.take(rows, np.arange(left, left + width), axis=1, mode="wrap")
