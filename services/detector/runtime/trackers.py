"""Ultralytics' trackers, each on the results of one camera alone. They know no appearance, so they fetch no model."""

from collections.abc import Sequence
from typing import Any, Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from ultralytics.engine.results import Boxes
from ultralytics.trackers.bot_sort import BOTSORT
from ultralytics.trackers.byte_tracker import BYTETracker
from ultralytics.trackers.utils.gmc import GMC
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

LOOKED_AT: Final = 160
"""The width in pixels at which images are compared: on the simulator's drives no worse than at twice that."""


class CameraMotion(GMC):
    """How the image moves because the camera does, by sparse optical flow in a small copy of it."""

    def __init__(self) -> None:
        super().__init__("sparseOptFlow", downscale=1)
        self._size: tuple[int, ...] = ()

    def apply(self, raw_frame: NDArray[Any], detections: NDArray[Any] | list[Any] | None = None) -> NDArray[np.float64]:
        """Return the last image's way to this one as a matrix of 2 x 3; an image of another size is the first one."""
        scale = min(1.0, LOOKED_AT / raw_frame.shape[1])
        small = cv2.resize(raw_frame, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        if small.shape != self._size:
            self.reset_params()
            self._size = small.shape
        warp = np.array(super().apply(small, detections), np.float64)
        warp[:, 2] /= scale
        return warp


class UltralyticsTracker:
    """Follows the objects of one camera with Ultralytics' own settings."""

    def __init__(self, kind: Kind) -> None:
        self._tracker = CLASSES[kind](IterableSimpleNamespace(**YAML.load(check_yaml(f"{kind}.yaml"))))
        self._looks = kind == "botsort"
        if self._looks:
            self._tracker.gmc = CameraMotion()

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
