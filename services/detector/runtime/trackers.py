"""Ultralytics' trackers, each on the results of one camera alone. They know no appearance, so they fetch no model."""

from collections.abc import Sequence
from typing import Any, Final, Literal

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
from services.detector.pixels import glance

Kind = Literal["bytetrack", "botsort"]

CLASSES: Final[dict[Kind, type[Any]]] = {"bytetrack": BYTETracker, "botsort": BOTSORT}
NUMBER: Final = 4
INDEX: Final = 7
"""Places in a tracker's rows: left, top, right, bottom, number, score, class, index of the object."""

LOOKED_AT: Final = 160
"""The width in pixels at which images are compared: on the simulator's drives no worse than at twice that."""


OURS: Final = {"fuse_score": False, "new_track_thresh": 0.35}
"""Settings other than Ultralytics'. Fused with scores, the overlap of what a model is not sure of is never enough to be
followed; instead what nothing sure began is not followed."""


class CameraMotion(GMC):
    """How the image moves because the camera does, by sparse optical flow in a small copy of it."""

    def __init__(self) -> None:
        super().__init__("sparseOptFlow", downscale=1)
        self._shape: tuple[int, ...] = ()
        self._scale = 1.0

    def look(self, frame: ImageFrame) -> NDArray[np.uint8]:
        """Return what `apply` is to be given of an image."""
        small = glance(frame, LOOKED_AT)
        if small.shape != self._shape:
            self.reset_params()
            self._shape = small.shape
        self._scale = small.shape[1] / frame.width
        return small[..., None]

    def apply(self, raw_frame: NDArray[Any], detections: NDArray[Any] | list[Any] | None = None) -> NDArray[np.float64]:
        """Return the last image's way to this one as a matrix of 2 x 3; an image of another size is the first one."""
        warp = np.array(super().apply(raw_frame, detections), np.float64)
        warp[:, 2] /= self._scale
        return warp


class UltralyticsTracker:
    """Follows the objects of one camera."""

    def __init__(self, kind: Kind) -> None:
        settings = {**YAML.load(check_yaml(f"{kind}.yaml")), **OURS}
        self._tracker = CLASSES[kind](IterableSimpleNamespace(**settings))
        self._motion = CameraMotion() if kind == "botsort" else None
        if self._motion is not None:
            self._tracker.gmc = self._motion

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        """See `Tracker.update`."""
        rows = [[*_corners(each), each.score, each.label] for each in objects]
        boxes = Boxes(np.array(rows, np.float32).reshape(-1, 6), (frame.height, frame.width))
        numbers: list[int | None] = [None] * len(objects)
        for row in self._tracker.update(boxes, None if self._motion is None else self._motion.look(frame)):
            numbers[int(row[INDEX])] = int(row[NUMBER])
        return numbers


def _corners(found: Detection) -> tuple[float, float, float, float]:
    return found.box.x1, found.box.y1, found.box.x2, found.box.y2
