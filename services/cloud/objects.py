"""Builds messages of objects: points, colours, and shapes in the points' frame and the target frame. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from schemas.header import Header
from schemas.objects import ObjectCloud, Shape, UprightBox
from schemas.transforms import Transform
from services.cloud.outlines import Cutout
from services.cloud.upright_boxes import Boxes, Level
from services.geometry.rotation import moved, quaternion_of

Numbers = NDArray[np.float64]

ROS_UP: Final = np.array([0.0, 0.0, 1.0])
ROS_LEVEL: Final = Level.of(ROS_UP)
OPTICAL_UP: Final = np.array([0.0, -1.0, 0.0])
OPTICAL: Final = "optical"


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """The target frame. from_points: 4 x 4, moves points into it, or absent where `unknown` gives the reason."""

    frame_id: str = ""
    from_points: Numbers | None = None
    unknown: str = ""

    def up(self, frame_id: str) -> Numbers:
        """Return the up direction in the points' frame: the target's z where known, else that of ROS REP 103."""
        if self.from_points is not None:
            return np.asarray(self.from_points[2, :3])
        return OPTICAL_UP if OPTICAL in frame_id else ROS_UP

    def transform(self, points: Header) -> Transform | None:
        """Return the points' frame in the target frame."""
        if self.from_points is None:
            return None
        x, y, z, w = quaternion_of(self.from_points).tolist()
        return Transform(
            frame_id=self.frame_id,
            child_frame_id=points.frame_id,
            stamp_ns=points.stamp_ns,
            translation=_three(self.from_points[:3, 3].tolist()),
            rotation=(x, y, z, w),
        )


def objects_of(
    found: Sequence[Detection],
    points: Mapping[int, Cutout],
    shapes: tuple[Numbers, Boxes],
    level: Level,
    target: Target,
) -> list[ObjectCloud]:
    """Return the clouds of the detections that have points.

    shapes: their centroids (n, 3) and boxes, that stand upright by `level`.
    """
    here = _shapes(*shapes, level)
    there = [None] * len(here) if target.from_points is None else _moved(target.from_points, *shapes)
    return [
        ObjectCloud(
            name=found[index].name,
            label=found[index].label,
            index=index,
            track=found[index].track,
            xyz=_octets(cv2.merge(list(own.xyz)).astype("<f4", copy=False)),
            rgb=_octets(own.rgb),
            shape=shape,
            in_target=in_target,
        )
        for (index, own), shape, in_target in zip(points.items(), here, there, strict=True)
    ]


def _octets(values: NDArray[Any] | None) -> memoryview:
    return memoryview(b"") if values is None else np.ascontiguousarray(values).reshape(-1).view(np.uint8).data


def _moved(transform: Numbers, centroids: Numbers, boxes: Boxes) -> list[Shape]:
    """Return shapes in the target frame, whose z axis is the given up direction."""
    there = Boxes(moved(transform, boxes.centres), boxes.sizes, boxes.along @ transform[:3, :3].T)
    return _shapes(moved(transform, centroids), there, ROS_LEVEL)


def _shapes(centroids: Numbers, boxes: Boxes, level: Level) -> list[Shape]:
    up = _three(level.up.tolist())
    numbers = (each.tolist() for each in (centroids, boxes.centres, boxes.sizes, level.yaws(boxes.along)))
    return [
        Shape(
            centroid=_three(centroid),
            box=UprightBox(centre=_three(centre), size=_three(size), yaw=yaw, up=up),
        )
        for centroid, centre, size, yaw in zip(*numbers, strict=True)
    ]


def _three(vector: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = vector
    return x, y, z
