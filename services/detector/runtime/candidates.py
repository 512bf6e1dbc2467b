"""What a model may have found in one image. Pure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Corners in pixels of the input (n x 4), scores (n), labels (n) and mask coefficients (n x m)."""

    corners: Floats
    scores: Floats
    labels: NDArray[np.int64]
    coefficients: Floats

    def __getitem__(self, which: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "Candidates":
        return Candidates(self.corners[which], self.scores[which], self.labels[which], self.coefficients[which])
