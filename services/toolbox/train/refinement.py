"""The detector's own close-ups and network, for the training of its refiner."""

from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.detector.model import Request
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.refinement.closeups import SIDE, CloseUps, stretched
from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.torch_refiner import kept
from services.simulator.training.refining.refinement import Look, Looks, Refinement
from services.toolbox.train.inference import CAMERA, framed, objects_of, open_model

CONFIDENCE: Final = 0.1
"""Score from which on objects are looked at: a refiner should know those that are unsure too."""

MAX_OBJECTS: Final = 60


class _Witness:
    """A `Refiner` that refines nothing, and keeps what it was shown."""

    def __init__(self) -> None:
        self.seen: CloseUps | None = None

    def run(self, seen: CloseUps) -> NDArray[np.float32]:
        self.seen = seen
        return np.zeros((len(seen.labels), SIDE, SIDE), np.float32)


@lru_cache(1)  # a process looks at many pictures with the same weights
def open_look(weights: Path, folder: Path) -> Look:
    """Load weights as a detector does; see `Refinement.open`.

    Raises:
        ModelError: no model, or none that finds masks of the simulated world's classes.
    """
    witness = _Witness()
    model = open_model(weights, None, folder=folder, refiner=witness, confidence=CONFIDENCE, max_detections=MAX_OBJECTS)

    def look(image: NDArray[np.uint8]) -> Looks:
        (outcome,) = model.run([Request(CAMERA, framed(image), masks=True)])
        objects_of(weights, outcome)
        seen = witness.seen
        assert seen is not None  # noqa: S101 - masks were asked for
        letterbox = Letterbox.fit(image.shape[0], image.shape[1], model.facts.longest, model.facts.stride)
        masks = (seen.pixels[..., 3] > 127) & (seen.pixels[..., 5] > 0)
        return Looks(seen.pixels, seen.features, seen.labels, _in_picture(seen.windows, letterbox), masks)

    return look


def _in_picture(windows: NDArray[np.int64], letterbox: Letterbox) -> NDArray[np.int64]:
    """Return windows of the model's input as windows of the picture, none of them empty."""
    places = windows.astype(np.float32)
    across, down = letterbox.columns.to_image(places[:, 0::2]), letterbox.rows.to_image(places[:, 1::2])
    low = np.floor(np.stack([across[:, 0], down[:, 0]], axis=1)).astype(np.int64)
    low = np.minimum(low, [letterbox.columns.image - 1, letterbox.rows.image - 1])
    high = np.maximum(np.ceil(np.stack([across[:, 1], down[:, 1]], axis=1)).astype(np.int64), low + 1)
    return np.concatenate([low, high], axis=1)


REFINEMENT: Final = Refinement(open=open_look, network=RefinerNetwork, stretched=stretched, kept=kept)
