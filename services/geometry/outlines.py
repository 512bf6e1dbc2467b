"""Polygons around masks, as labels of pictures have them. Pure."""

from collections.abc import Sequence
from typing import Final, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

Polygon = NDArray[np.int32]
Number = TypeVar("Number", np.int32, np.float64)
TOLERANCE: Final = 0.6
MIN_PART: Final = 24.0


def outline(mask: NDArray[np.uint8]) -> Polygon | None:
    """One polygon (n, 2) of pixel coordinates (column, row) around a 0/1 mask, or None for a sliver.

    Separate parts and holes are joined by cuts of no width, so that filling by the even-odd rule gives the mask.
    """
    contours, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = [cv2.approxPolyDP(c, TOLERANCE, closed=True)[:, 0] for c in contours if cv2.contourArea(c) >= MIN_PART]
    found = [np.asarray(ring, np.int32) for ring in rings if len(ring) >= 3]
    return joined(found) if found else None


def joined(rings: Sequence[NDArray[Number]]) -> NDArray[Number]:
    """Return one polygon of several, the largest first, by cuts of no width from each to the next."""
    ordered = sorted(rings, key=lambda ring: cv2.contourArea(ring.astype(np.float32)), reverse=True)
    whole = ordered[0]
    for ring in ordered[1:]:
        whole = _splice(whole, ring)
    return whole


def _splice(path: NDArray[Number], ring: NDArray[Number]) -> NDArray[Number]:
    gaps = np.sum((path[:, None] - ring[None]) ** 2, axis=2)
    here, there = np.unravel_index(int(gaps.argmin()), gaps.shape)
    loop = np.concatenate([ring[there:], ring[: there + 1]])
    return np.concatenate([path[: here + 1], loop, path[here:]])
