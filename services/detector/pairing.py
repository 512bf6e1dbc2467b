"""Two models on the same images: one for boxes, one for the masks of what the first found."""

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import msgspec

from schemas.detections import Detection
from schemas.header import MAX_LABEL
from schemas.tuning import Tuning
from services.detector.model import SILENT, Failed, Found, Model, Outcome, Request
from services.detector.runtime.agreement import overlap

MIN_OVERLAP: Final = 0.5
"""Of the two models' boxes, for one's mask to be the other's object's."""


class PairedModel:
    """Objects are the first model's; each has the mask of the second's best object of that name in the same place.

    The second is asked only for images whose masks somebody wants. Settings hold for both; classes must be known to
    both.
    """

    def __init__(self, boxes: Model, masks: Model) -> None:
        self._boxes = boxes
        self._masks = masks
        self.name = f"{boxes.name}+{masks.name}"[:MAX_LABEL]
        self.in_flight = min(boxes.in_flight, masks.in_flight)
        self.segments = masks.segments

    @property
    def max_batch(self) -> int:
        """See `Model.max_batch`."""
        return min(self._boxes.max_batch, self._masks.max_batch)

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `Model.remarks`."""
        of_boxes = (remark for remark in self._boxes.remarks if not remark.endswith(SILENT))  # masks are the other's
        return (*of_boxes, *self._masks.remarks)

    @property
    def tuning(self) -> Tuning:
        """See `Model.tuning`."""
        return self._boxes.tuning

    def tune(self, tuning: Tuning) -> None:
        """See `Model.tune`."""
        before = self._boxes.tuning
        self._boxes.tune(tuning)
        try:
            self._masks.tune(tuning)
        except Exception:
            self._boxes.tune(before)
            raise

    def close(self) -> None:
        """See `Model.close`."""
        self._boxes.close()
        self._masks.close()

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        masked = [request for request in batch if request.masks]
        async with asyncio.TaskGroup() as group:
            boxes = group.create_task(self._boxes.infer([replace(request, masks=False) for request in batch]))
            masks = group.create_task(self._masks.infer(masked))
        left = iter(masks.result())
        return [
            joined(outcome, next(left)) if request.masks else outcome
            for request, outcome in zip(batch, boxes.result(), strict=True)
        ]


def joined(boxes: Outcome, masks: Outcome) -> Outcome:
    """Give one model's objects the other's masks; where the other failed, none."""
    if isinstance(boxes, Failed) or isinstance(masks, Failed):
        return boxes
    left = list(masks.objects)
    objects = []
    for each in boxes.objects:
        best = max(left, key=lambda other: _fit(each, other), default=None)
        if best is not None and _fit(each, best) >= MIN_OVERLAP:
            left.remove(best)
            each = msgspec.structs.replace(each, mask=best.mask)  # noqa: PLW2901 - the same object, with its mask
        objects.append(each)
    spans = {name: boxes.spans.get(name, 0) + masks.spans.get(name, 0) for name in {**boxes.spans, **masks.spans}}
    return Found(objects, spans)


def _fit(one: Detection, other: Detection) -> float:
    return overlap(one.box, other.box) if one.name == other.name else 0.0
