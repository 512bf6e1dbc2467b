"""Reads the depth of objects' keypoints. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import IN_VIEW, Detection
from services.geometry.depth import Depth

MAX_TOTAL: Final = 20_000
"""Keypoints of one image that are looked at, those of the surest objects."""

NEEDED: Final = 3
"""Keypoints with a reading that an object's distance takes."""

REACH_M: Final = 1.5
"""How far from an object's distance its keypoints may be, as a hand is; farther readings are of something else."""

_PATCH: Final = np.array([(x, y) for y in range(-2, 3) for x in range(-2, 3)]).T
"""Pixels around a keypoint that are looked at: columns and rows from its own."""

_SURFACE_M: Final = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class KeypointReadings:
    """The n keypoints of an object. z: metres along the optical axis, NaN of those out of view or without a reading.

    at: their flat places in the image. in_view: how many are.
    """

    z: NDArray[Any]
    at: NDArray[np.intp]
    in_view: int

    def near(self, axial_m: float) -> NDArray[np.bool_]:
        """Return which of them can be those of an object at a distance."""
        return np.asarray(np.abs(self.z - axial_m) <= REACH_M)  # False of NaN


def read_keypoints(objects: Sequence[Detection], depth: Depth) -> Iterator[tuple[int, KeypointReadings]]:
    """Yield the readings of objects that have keypoints, with their places among the objects.

    Of the pixels around a keypoint those on the nearest surface count: a hand before a wall is the hand.
    """
    height, width = depth.shape
    total = 0
    for index, found in enumerate(objects):
        points = found.keypoints or ()
        total += len(points)
        if not points or total > MAX_TOTAL:
            continue
        columns = np.minimum(np.array([each.x for each in points]).astype(np.intp), width - 1)
        rows = np.minimum(np.array([each.y for each in points]).astype(np.intp), height - 1)
        in_view = np.array([each.score >= IN_VIEW for each in points])
        across = np.clip(columns[:, None] + _PATCH[0], 0, width - 1)
        down = np.clip(rows[:, None] + _PATCH[1], 0, height - 1)
        z = depth.metres_of(down * width + across).astype(np.float64)
        z[~(z > 0) | ~in_view[:, None]] = np.inf
        z[z > z.min(axis=1, keepdims=True) + _SURFACE_M] = np.nan
        z[np.isinf(z)] = np.nan
        middles = np.full(len(points), np.nan)
        read = np.isfinite(z).any(axis=1)
        middles[read] = np.nanmedian(z[read], axis=1)
        yield index, KeypointReadings(middles, rows * width + columns, int(in_view.sum()))
