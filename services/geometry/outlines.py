"""Polygons around masks, as labels of pictures have them. Pure."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

Polygon = NDArray[np.int32]
TOLERANCE: Final = 0.6
MIN_PART: Final = 24.0


def outline(mask: NDArray[np.uint8]) -> Polygon | None:
    """One polygon (n, 2) of pixel coordinates (column, row) around a 0/1 mask, or None for a sliver.

    Separate parts and holes are joined by cuts of no width, so that filling by the even-odd rule gives the mask.
    """
    contours, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = [cv2.approxPolyDP(c, TOLERANCE, closed=True)[:, 0] for c in contours if cv2.contourArea(c) >= MIN_PART]
    rings = sorted((ring for ring in rings if len(ring) >= 3), key=cv2.contourArea, reverse=True)
    if not rings:
        return None
    joined = np.asarray(rings[0], np.int32)
    for ring in rings[1:]:
        joined = _splice(joined, np.asarray(ring, np.int32))
    return joined


def _splice(path: Polygon, ring: Polygon) -> Polygon:
    gaps = np.sum((path[:, None] - ring[None]) ** 2, axis=2)
    here, there = np.unravel_index(int(gaps.argmin()), gaps.shape)
    loop = np.concatenate([ring[there:], ring[: there + 1]])
    return np.concatenate([path[: here + 1], loop, path[here:]])
