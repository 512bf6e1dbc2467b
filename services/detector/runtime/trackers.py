"""Ultralytics' trackers, each on the results of one camera alone. They know no appearance, so they fetch no model."""

from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
from ultralytics.engine.results import Boxes
from ultralytics.trackers.bot_sort import BOTSORT
from ultralytics.trackers.byte_tracker import BYTETracker
from ultralytics.utils import YAML, IterableSimpleNamespace
from ultralytics.utils.checks import check_yaml

from schemas.detections import Detection
from schemas.image import ImageFrame
from services.detector.pixels import to_bgr

Kind = Literal["bytetrack", "botsort"]

CLASSES: Final[dict[Kind, type[Any]]] = {"bytetrack": BYTETracker, "botsort": BOTSORT}
NUMBER: Final = 4
INDEX: Final = 7
"""Places in a tracker's rows: left, top, right, bottom, number, score, class, index of the object."""


class UltralyticsTracker:
    """Follows the objects of one camera with Ultralytics' own settings."""

    def __init__(self, kind: Kind) -> None:
        self._tracker = CLASSES[kind](IterableSimpleNamespace(**YAML.load(check_yaml(f"{kind}.yaml"))))
        self._looks = kind == "botsort"

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        """See `Tracker.update`."""
        rows = [[*_corners(each), each.score, each.label] for each in objects]
        boxes = Boxes(np.array(rows, np.float32).reshape(-1, 6), (frame.height, frame.width))
        numbers: list[int | None] = [None] * len(objects)
        for row in self._tracker.update(boxes, to_bgr(frame) if self._looks else None):
            numbers[int(row[INDEX])] = int(row[NUMBER])
        return numbers


def _corners(found: Detection) -> tuple[float, float, float, float]:
    return found.box.x1, found.box.y1, found.box.x2, found.box.y2
