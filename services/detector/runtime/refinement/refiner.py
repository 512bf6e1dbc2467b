"""What refines masks, whichever library it is."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.detector.runtime.refinement.closeups import CloseUps


class Refiner(Protocol):
    """Refines masks. Used from one thread at a time."""

    def run(self, seen: CloseUps) -> NDArray[np.float32]:
        """Return the log odds of each object's mask in its close-up, n x SIDE x SIDE."""
