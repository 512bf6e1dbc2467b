"""The detector's own close-ups and network, for the training of its refiner."""

from collections.abc import Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.detector.model import Request
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.refiner import (
    BOX,
    COARSE,
    SIDE,
    CloseUps,
    Refined,
    blank_close_ups,
    halved,
    stretched,
)
from services.detector.runtime.refinement.torch_refiner import KEY, kept
from services.toolbox.train.inference import CAMERA, framed, objects_of, open_model
from services.training.checkpoints import extras_of
from services.training.refining.refinement import Looks, Refinement, RefinerLook

CONFIDENCE: Final = 0.03
"""Score from which on objects are looked at: a refiner should know what is unsure, and most of that is nothing."""

MAX_OBJECTS: Final = 60


NOTHING: Final = blank_close_ups(0, 0)


class _Witness:
    """A `Refiner` that refines nothing, and records its inputs."""

    def __init__(self) -> None:
        self._seen = NOTHING

    def asked(self) -> CloseUps:
        """Return the inputs recorded since the last call, if there were any."""
        seen, self._seen = self._seen, NOTHING
        return seen

    def run(self, seen: CloseUps) -> Refined:
        self._seen = seen
        return Refined(np.zeros((len(seen.labels), SIDE, SIDE), np.float32), np.zeros(len(seen.labels), np.float32))


@lru_cache(1)  # a process looks at many pictures with the same weights
def open_look(weights: Path, device: str, folder: Path) -> RefinerLook:
    """Load weights as a detector does; see `Refinement.open`.

    Raises:
        ModelError: no model, or none that finds masks of the simulated world's classes.
    """
    witness = _Witness()
    model = open_model(
        weights, device, folder=folder, refiner=witness, confidence=CONFIDENCE, max_detections=MAX_OBJECTS
    )

    def look(image: NDArray[np.uint8]) -> Looks:
        (outcome,) = model.run([Request(CAMERA, framed(image), masks=True)])
        objects_of(weights, outcome)
        seen = witness.asked()
        letterbox = Letterbox.fit(image.shape[0], image.shape[1], model.facts.longest, model.facts.stride)
        masks = (seen.pixels[..., COARSE] > 127) & (seen.pixels[..., BOX] > 0)
        place = partial(_letterboxed, letterbox)
        return Looks(seen.pixels, halved(seen.features), seen.labels, seen.scores, seen.windows, masks, place)

    return look


def _letterboxed(letterbox: Letterbox, mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """See `Looks.letterboxed`."""
    rows, columns = letterbox.rows, letterbox.columns
    placed = np.zeros(letterbox.shape, np.uint8)
    content = cv2.resize(mask, (columns.content, rows.content), interpolation=cv2.INTER_LINEAR)
    placed[rows.before : rows.before + rows.content, columns.before : columns.before + columns.content] = content
    return placed


def state_in(weights: Path) -> Mapping[str, Any] | None:
    """Return the state of the refiner in weights; nothing in the file is executed."""
    state: Mapping[str, Any] | None = extras_of(weights).get(KEY)
    return state


REFINEMENT: Final = Refinement(
    open=open_look, network=RefinerNetwork, stretched=stretched, kept=kept, state_in=state_in
)
