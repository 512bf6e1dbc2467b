"""Which object a detection is of. Pure."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from pycocotools import mask as coco

from benchmarks.space.messages import true_detections
from schemas.detections import Detection
from services.simulator.world import SeenObject

LEAST_IOU: Final = 0.5


def matched(found: Sequence[Detection], objects: Sequence[SeenObject]) -> dict[int, SeenObject]:
    """Return by its place the object of its class that a detection's mask has an IoU of LEAST_IOU with, if any.

    found: best first; of several detections of the same object the best has it.
    """
    if not found or not objects:
        return {}
    overlap = np.asarray(coco.iou(_rle(found), _rle(true_detections(objects)), [0] * len(objects)))
    matches: dict[int, SeenObject] = {}
    for place, detection in enumerate(found):
        of_class = np.array([each.name == detection.name for each in objects])
        best = int(np.argmax(np.where(of_class, overlap[place], 0)))
        if of_class[best] and overlap[place, best] >= LEAST_IOU and objects[best] not in matches.values():
            matches[place] = objects[best]
    return matches


def _rle(found: Sequence[Detection]) -> list[dict[str, object]]:
    return [{"size": list(each.mask.size), "counts": each.mask.counts} for each in found if each.mask is not None]
