"""What refines masks, whichever library it is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from services.detector.runtime.refinement.closeups import SIDE, CloseUps

Floats = NDArray[np.float32]

AT_ONCE: Final = 32
"""Close-ups that are computed together: more need more memory, and are no quicker each."""


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Masks of objects in their close-ups.

    odds: log odds, n x SIDE x SIDE. qualities: the IoU to expect of each mask with the true one (n), 0 to 1.
    """

    odds: Floats
    qualities: Floats


class Refiner(Protocol):
    """Refines masks. Used from one thread at a time."""

    def run(self, seen: CloseUps) -> Refined:
        """Refine the mask of each object."""


def refined(seen: CloseUps, compute: Callable[[list[NDArray[Any]]], tuple[Floats, Floats]]) -> Refined:
    """Refine a few at a time. compute: what `RefinerNetwork.forward` takes to what it returns."""
    given: tuple[NDArray[Any], ...] = (seen.pixels, seen.features, seen.labels, seen.scores)
    count = len(seen.labels)
    found = Refined(np.empty((count, SIDE, SIDE), np.float32), np.empty(count, np.float32))
    for begin in range(0, count, AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        found.odds[part], qualities = compute([each[part] for each in given])
        found.qualities[part] = 1 / (1 + np.exp(-qualities.astype(np.float64)))  # whose range is never left
    return found
