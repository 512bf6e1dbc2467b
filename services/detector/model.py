"""What the worker asks of a model, whichever library runs it."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection


class ModelError(Exception):
    """A model that cannot be used; the message says which and why."""


class Model(Protocol):
    """A loaded detection or segmentation model. Used from one thread at a time."""

    @property
    def name(self) -> str:
        """What results say they come from."""

    def infer(self, image: NDArray[np.uint8], *, masks: bool) -> list[Detection]:
        """Return the objects in a height x width x 3 BGR image, best score first, with masks if asked for and known."""
