"""Pairs two models on the same images: one finds boxes, the other the masks of these objects."""

import asyncio
import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from schemas.header import MAX_LABEL
from schemas.tuning import Tuning
from services.detector.model import NO_MASKS, NO_MASKS_OF_POSES, DetectedObjects, Failed, Model, Outcome, Request
from services.detector.runtime.overlap import boxes_of, ious

log = logging.getLogger(__name__)

MIN_OVERLAP: Final = 0.5
"""Minimum overlap of the two models' boxes for one to lend the other its mask."""


class PairedModel:
    """Takes the first model's objects, each with the mask of the second's best overlapping object of the same name.

    The second is asked only for images whose masks somebody wants. Settings hold for both; classes must be known to
    both.
    """

    def __init__(self, boxes: Model, masks: Model) -> None:
        self._boxes = boxes
        self.masks = masks
        self.name = f"{boxes.name}+{masks.name}"[:MAX_LABEL]
        self.in_flight = min(boxes.in_flight, masks.in_flight)
        self.segments = masks.segments

    @property
    def max_batch(self) -> int:
        """See `Model.max_batch`."""
        return min(self._boxes.max_batch, self.masks.max_batch)

    @property
    def runtime(self) -> str:
        """See `Model.runtime`."""
        return "+".join(dict.fromkeys((self._boxes.runtime, self.masks.runtime)))

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `Model.remarks`."""
        # the other model makes the masks
        of_boxes = (remark for remark in self._boxes.remarks if not remark.endswith((NO_MASKS, NO_MASKS_OF_POSES)))
        return (*of_boxes, *self.masks.remarks)

    @property
    def tuning(self) -> Tuning:
        """See `Model.tuning`."""
        return self._boxes.tuning

    @property
    def classes(self) -> tuple[str, ...]:
        """See `Model.classes`."""
        return self._boxes.classes

    def tune(self, tuning: Tuning) -> None:
        """See `Model.tune`."""
        before = self._boxes.tuning
        self._boxes.tune(tuning)
        try:
            self.masks.tune(tuning)
        except Exception:
            self._boxes.tune(before)
            raise

    def close(self) -> None:
        """See `Model.close`."""
        self._boxes.close()
        self.masks.close()

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        masked = [request for request in batch if request.masks]
        try:
            async with asyncio.TaskGroup() as group:
                boxes = group.create_task(self._boxes.infer([replace(request, masks=False) for request in batch]))
                masks = group.create_task(self.masks.infer(masked))
        except ExceptionGroup as failed:
            raise failed.exceptions[0] from failed
        left = iter(masks.result())
        return [
            _joined(request, outcome, next(left)) if request.masks else outcome
            for request, outcome in zip(batch, boxes.result(), strict=True)
        ]


def _joined(request: Request, boxes: Outcome, masks: Outcome) -> Outcome:
    if isinstance(boxes, Failed):
        return boxes
    if isinstance(masks, Failed):
        seq = request.frame.header.seq
        log.warning("%s: frame %d has no masks, %s: %r", request.camera, seq, masks.reason, masks.error)
        return boxes
    return joined(boxes, masks)


def joined(boxes: DetectedObjects, masks: DetectedObjects) -> DetectedObjects:
    """Assign the other model's masks to one model's objects, best first, each mask once."""
    fits = _fits(boxes.objects, masks.objects)
    objects = list(boxes.objects)
    for n, fit in enumerate(fits if masks.objects else ()):
        best = int(fit.argmax())
        if fit[best] >= MIN_OVERLAP:
            objects[n] = msgspec.structs.replace(objects[n], mask=masks.objects[best].mask)
            fits[:, best] = 0
    spans = {name: boxes.spans.get(name, 0) + masks.spans.get(name, 0) for name in {**boxes.spans, **masks.spans}}
    return DetectedObjects(objects, spans)


def _fits(some: Sequence[Detection], others: Sequence[Detection]) -> NDArray[np.float64]:
    """Return the overlap (some x others, 0 to 1) of boxes of objects of the same name; 0 where names differ."""
    _, names = np.unique([each.name for each in (*some, *others)], return_inverse=True)
    same = np.equal.outer(names[: len(some)], names[len(some) :])
    return np.where(same, ious(boxes_of(some), boxes_of(others)), 0)
