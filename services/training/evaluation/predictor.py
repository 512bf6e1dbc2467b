"""The interface of a model to the evaluation."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection

Predictor = Callable[[NDArray[np.uint8]], Sequence[Detection]]
"""Finds the objects in a height x width x 3 RGB picture, best score first, with masks of the picture's own size."""

CONFIDENCE: Final = 0.25
"""The lowest score that counts unless a detector is told otherwise."""

LOWEST_CONFIDENCE: Final = 0.001
"""The lowest score asked for where a figure is over all scores."""


class PredictorLoader(Protocol):
    """Loads a model."""

    def __call__(
        self, weights: Path, *, confidence: float, device: str | None, folder: Path, any_model: bool = False
    ) -> Predictor:
        """Return the predictor of `weights`, with scores of at least `confidence`.

        device: in Ultralytics' words, or None for the best there is. folder: where files of its own may go. any_model:
        whether it may find boxes alone, and other classes than the world's.

        Raises:
            TrainingError: no model, or not such a one.
        """
