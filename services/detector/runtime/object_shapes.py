"""Reads rotated boxes, which are drawn as masks, and keypoints off a model's output. Pure."""

from collections.abc import Iterator, Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import IN_VIEW, Keypoint, RotatedBox
from schemas.image import MAX_SIDE
from services.detector.runtime.candidates import BLOCK, Candidates, Integers
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.model_file import Task
from services.geometry.masks import Window

Floats = NDArray[np.float32]
Corners = NDArray[np.float64]

PEOPLE: Final = 17
"""Keypoints of COCO's people: nose, eyes, ears, shoulders, elbows, wrists, hips, knees, ankles; left before right."""

LIMBS: Final = (
    *((0, 1), (0, 2), (1, 3), (2, 4), (5, 7), (7, 9), (6, 8), (8, 10)),
    *((5, 6), (5, 11), (6, 12), (11, 12), (11, 13), (13, 15), (12, 14), (14, 16)),
)
MAX_ROTATED: Final = 2_000

_FRACTION: Final = 4
"""Bits of a pixel's fraction in OpenCV's coordinates."""

_LEAST: Final = 1e-7


def rotated_suppressed(found: Candidates, labels: Integers, iou: float, most: int) -> Integers:
    """Return which rotated boxes, best first, overlap no better one of their class by more than `iou`.

    Overlap is that of the Gaussians that fit the boxes (ProbIoU, Llerena et al. 2021), and a box that is suppressed
    suppresses others all the same, as in Ultralytics. Of the MAX_ROTATED best: each is compared with all before it.
    """
    x, y, width, height = _middles(found.corners[:MAX_ROTATED]).T.astype(np.float64)
    angles = found.coefficients[:MAX_ROTATED, 0].astype(np.float64)
    cos, sin = np.cos(angles), np.sin(angles)
    along, across = width**2 / 12, height**2 / 12
    a, b, c = along * cos**2 + across * sin**2, along * sin**2 + across * cos**2, (along - across) * cos * sin
    sizes = np.maximum(a * b - c**2, 0)
    kept = np.empty(0, np.int64)
    for begin in range(0, len(x), BLOCK):
        end = min(begin + BLOCK, len(x))
        i, j = np.arange(begin, end)[:, None], np.arange(end)[None]
        a2, b2, c2 = a[i] + a[j], b[i] + b[j], c[i] + c[j]
        size = np.maximum(a2 * b2 - c2**2, 0)
        dx, dy = x[i] - x[j], y[i] - y[j]
        apart = ((a2 * dy**2 + b2 * dx**2) / 4 - c2 * dx * dy / 2) / (size + _LEAST)
        unlike = np.log(size / (4 * np.sqrt(sizes[i] * sizes[j]) + _LEAST) + _LEAST) / 2
        overlap = 1 - np.sqrt(1 - np.exp(-np.clip(apart + unlike, _LEAST, 100)) + _LEAST)
        doubles = (overlap > iou) & (labels[i] == labels[j]) & (j < i)
        kept = np.concatenate([kept, begin + np.flatnonzero(~doubles.any(axis=1))])[:most]
        if len(kept) == most:
            break
    return kept


def _middles(corners: Floats) -> Floats:
    """Return middles and sizes of boxes, n x 4."""
    return np.concatenate([(corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]], axis=1)


def rotated_boxes(found: Candidates, letterbox: Letterbox) -> list[RotatedBox]:
    """Return objects' rotated boxes in the image."""
    middles = _middles(found.corners)
    x, y = letterbox.columns.beyond(middles[:, 0]), letterbox.rows.beyond(middles[:, 1])
    scales = [axis.image / axis.content for axis in (letterbox.columns, letterbox.rows)]
    sides = np.clip(middles[:, 2:] * np.array(scales, np.float32), 0, 2 * MAX_SIDE)
    places = np.clip(np.stack([x, y], axis=1), -MAX_SIDE, 2 * MAX_SIDE)
    rows = np.concatenate([places, sides, np.remainder(found.coefficients[:, :1], np.pi)], axis=1)
    return [RotatedBox(*row) for row in rows.tolist()]


def corners_of(box: RotatedBox) -> Corners:
    """Return the corners of a rotated box, 4 x 2, in the order of its sides."""
    cos, sin = np.cos(box.angle), np.sin(box.angle)
    along, across = np.array([cos, sin]) * box.width / 2, np.array([-sin, cos]) * box.height / 2
    steps = np.array([-along - across, along - across, along + across, across - along])
    return np.asarray(np.add(steps, [box.x, box.y]))


def upright(boxes: Sequence[RotatedBox], letterbox: Letterbox) -> Floats:
    """Return the upright boxes around what of rotated ones is in the image, n x 4; of nothing they are empty."""
    right, bottom = letterbox.columns.image, letterbox.rows.image
    image = np.array([(0, 0), (right, 0), (right, bottom), (0, bottom)], np.float32)
    found = np.zeros((len(boxes), 4), np.float32)
    for row, box in zip(found, boxes, strict=True):
        area, inside = cv2.intersectConvexConvex(corners_of(box).astype(np.float32), image)
        if area > 0 and inside is not None:
            row[:2], row[2:] = inside.reshape(-1, 2).min(axis=0), inside.reshape(-1, 2).max(axis=0)
    return np.asarray(np.clip(found, 0, [right, bottom] * 2), np.float32)


def filled(boxes: Sequence[RotatedBox], around: Floats) -> Iterator[Window]:
    """Return rotated boxes as masks. around: the upright box of each in the image."""
    for box, (left, top, right, bottom) in zip(boxes, _whole(around), strict=True):
        drawn = np.zeros((bottom - top, right - left), np.uint8)
        if drawn.size:
            cv2.fillConvexPoly(drawn, _fixed(corners_of(box), left, top), 1, shift=_FRACTION)
        yield Window(top, left, drawn.view(np.bool_))


def keypoints_of(found: Candidates, letterbox: Letterbox, task: Task) -> list[list[Keypoint]]:
    """Return objects' keypoints in the image; those beyond its border are on it."""
    numbers = found.coefficients.reshape(len(found.labels), task.keypoints, -1)
    x, y = letterbox.columns.to_image(numbers[..., 0]), letterbox.rows.to_image(numbers[..., 1])
    scores = np.clip(numbers[..., 2], 0, 1) if task.has_scores else np.ones_like(x)
    rows = np.stack([x, y, scores], axis=2).tolist()
    return [[Keypoint(*point) for point in points] for points in rows]


def shown_limbs(points: Sequence[Keypoint]) -> Iterator[tuple[int, int]]:
    """Return the limbs of a person of which both ends are in view; none of anything else."""
    for one, other in LIMBS if len(points) == PEOPLE else ():
        if min(points[one].score, points[other].score) >= IN_VIEW:
            yield one, other


def _whole(boxes: Floats) -> list[list[int]]:
    """Return the pixels that boxes touch: first column and row, last column and row and one more."""
    edges = np.concatenate([np.floor(boxes[:, :2]), np.ceil(boxes[:, 2:])], axis=1)
    found: list[list[int]] = edges.astype(int).tolist()
    return found


def _fixed(points: Corners, left: int, top: int) -> NDArray[np.int32]:
    """Return points as OpenCV takes them: the middle of a window's first pixel is (0, 0)."""
    return np.rint((points - [left + 0.5, top + 0.5]) * (1 << _FRACTION)).astype(np.int32)
