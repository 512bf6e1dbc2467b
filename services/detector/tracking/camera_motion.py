"""Estimates how the parts of a camera's image move between two frames, by dense optical flow. Pure.

A robot that turns moves what is near and what is far differently, so each object is moved by what lies in its own box:
the median flow there, and how that grows across it (Kalal et al., "Forward-Backward Error", 2010, with a flow that is
dense: Kroeger et al., "Fast Optical Flow using Dense Inverse Search", 2016).
"""

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Floats = NDArray[np.float64]

LEAST_SIDE: Final = 32
"""Pixels of a side below which a picture's motion is not told. OpenCV's flow crashes below 16."""

PATCH_STRIDE: Final = 4
FINEST_SCALE: Final = 1

THUMBNAIL_WIDTH: Final = 40
"""Width in pixels at which a leap of the whole picture is looked for, further than the flow reaches by itself."""

STRIPS: Final = ((0, 15), (10, 30), (25, 40))
"""Columns of a thumbnail, of which the one that is found best in the next thumbnail tells the leap."""

VERTICAL_SEARCH_PX: Final = 2

SAMPLES: Final = 7
"""Samples of the flow along each side of a box."""

LEAST_SCALED: Final = 5.0
"""Pixels of a box's side, in the small picture, below which its growth cannot be read off."""

MOST_GROWTH: Final = 0.3


class Motion:
    """The flow between the last two images of one camera, each height x width in grey."""

    def __init__(self) -> None:
        self._flow = _dense_flow()
        self._last: Picture | None = None

    def look(self, picture: Picture) -> Floats | None:
        """Return how far each pixel of the last picture moved (height x width x 2: right, down).

        None of a camera's first picture, of one of another size than the last, and of one that is too small.
        """
        last, self._last = self._last, picture
        if last is None or last.shape != picture.shape:
            self._flow = _dense_flow()  # it fits itself to the size of its first pictures
            return None
        if min(picture.shape) < LEAST_SIDE:
            return None
        began = np.empty((*picture.shape, 2), np.float32)
        began[:] = leap(last, picture)
        return np.asarray(self._flow.calc(last, picture, began), np.float64)


def _dense_flow() -> cv2.DISOpticalFlow:
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow.setPatchStride(PATCH_STRIDE)
    flow.setFinestScale(FINEST_SCALE)
    flow.setVariationalRefinementIterations(0)
    return flow


def leap(before: Picture, after: Picture) -> tuple[float, float]:
    """Return roughly how far an image moved as a whole (right, down)."""
    factor = before.shape[1] / THUMBNAIL_WIDTH
    size = (THUMBNAIL_WIDTH, max(1, round(before.shape[0] / factor)))
    small, then = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (before, after))
    margin = cv2.copyMakeBorder(then, VERTICAL_SEARCH_PX, VERTICAL_SEARCH_PX, 0, 0, cv2.BORDER_REPLICATE)
    _, right, down = max(_found(small[:, begin:end], margin, begin) for begin, end in STRIPS)
    return right * factor, down * factor


def _found(strip: NDArray[Any], within: NDArray[Any], begin: int) -> tuple[float, int, int]:
    """Return how well a strip matches, at most 1, and its distance; a featureless strip stays in place."""
    if np.ptp(strip) == 0:
        return -1.0, 0, 0
    _, best, _, (column, row) = cv2.minMaxLoc(cv2.matchTemplate(within, strip, cv2.TM_CCOEFF_NORMED))
    return best, column - begin, row - VERTICAL_SEARCH_PX


def moved(boxes: NDArray[Any], flow: Floats, scale: float) -> Floats:
    """Return the boxes (n x 4, corners in pixels of the image) moved by the flow of the image.

    scale: how many times as big as the image the picture is whose flow it is.
    """
    height, width = flow.shape[:2]
    corners = np.asarray(boxes, np.float64) * scale
    centres, sizes = (corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    columns, rows = (
        np.clip(centres[:, axis, None] + steps * sizes[:, axis, None], 0, side - 1).astype(np.intp)
        for axis, side in enumerate((width, height))
    )
    sampled = flow[rows[:, :, None], columns[:, None, :]]
    centres = centres + np.median(sampled.reshape(len(corners), SAMPLES**2, 2), axis=1)
    across = _growth(np.median(sampled[..., 0], axis=1), sizes[:, 0])
    down = _growth(np.median(sampled[..., 1], axis=2), sizes[:, 1])
    sizes = sizes * (1 + np.clip((across + down) / 2, -MOST_GROWTH, MOST_GROWTH))[:, None]
    return np.asarray(np.concatenate([centres - sizes / 2, centres + sizes / 2], axis=1) / scale, np.float64)


def _growth(flows: Floats, sides: Floats) -> Floats:
    """Return the relative growth of sides whose ordered samples moved this far (n x SAMPLES)."""
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    slopes = flows @ steps / (steps @ steps)
    return np.where(sides < LEAST_SCALED, 0.0, slopes / np.maximum(sides, LEAST_SCALED))
