"""Blackens areas of images that nobody off the robot is to see. Pure.

An image is blackened before it is scaled or compressed, so that nothing of an area is left in its neighbours. One that
cannot be blackened is not sent.
"""

from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
import simplejpeg
from msgspec.structs import replace
from numpy.typing import NDArray

from gateway.to_bus.shaping.scaling import ShapingError, pixels_of, with_pixels
from schemas.compression import JPEG, RAW
from schemas.image import BYTES_PER_PIXEL, Area, ImageFrame

STEPS_PER_PIXEL: Final = 2

_BLACK: Final[dict[str, Any]] = {
    "rgba8": (0, 0, 0, 255),
    "bgra8": (0, 0, 0, 255),
    "yuv422": (128, 16),
    "32FC1": np.nan,
}
"""Black where it is not zeros; of depth, no reading."""

_SPACES: Final = {"rgb8": "RGB", "mono8": "GRAY"}


def blackened(frame: ImageFrame, areas: tuple[Area, ...]) -> ImageFrame:
    """Return the frame, raw, with these areas black; of depth they have no reading.

    Raises:
        ShapingError: it arrived compressed, and not as a JPEG that can be decoded.
    """
    raw = frame if frame.format == RAW else _decoded(frame)
    pixels = pixels_of(raw).copy()
    black = _BLACK.get(raw.encoding, 0)
    for row, begin, end in _runs(areas, *pixels.shape[:2]):
        pixels[row, begin:end] = black
    return with_pixels(raw, pixels)


def _decoded(frame: ImageFrame) -> ImageFrame:
    if frame.format != JPEG or frame.encoding not in _SPACES:
        raise ShapingError(f"a {frame.format} that arrived as one cannot be blackened in part: use the raw topic")
    try:
        pixels = simplejpeg.decode_jpeg(frame.data, _SPACES[frame.encoding])
    except ValueError as error:
        raise ShapingError(f"a jpeg that cannot be decoded: {error}") from error
    if pixels.shape[:2] != (frame.height, frame.width):
        raise ShapingError(f"a jpeg of other than {frame.width}x{frame.height} pixels")
    made: Any = np.ascontiguousarray(pixels)
    step = frame.width * BYTES_PER_PIXEL[frame.encoding]
    return replace(frame, format=RAW, step=step, data=memoryview(made.reshape(-1)))


@lru_cache(64)  # cameras have a few sizes
def _runs(areas: tuple[Area, ...], height: int, width: int) -> list[tuple[int, int, int]]:
    """Return the row, begin and end of each run of pixels that are covered."""
    covered = np.zeros((height, width + 2), np.int8)
    covered[:, 1:-1] = _covered(areas, height, width)
    rows, edges = np.nonzero(np.diff(covered, axis=1))
    return list(zip(rows[::2].tolist(), edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _covered(areas: tuple[Area, ...], height: int, width: int) -> NDArray[np.bool_]:
    """Return which pixels are in an area, touch it, or are beside one that does."""
    covered = np.zeros((height + 2, width + 2), np.bool_)
    within = covered[1:-1, 1:-1]
    for area in areas:
        corners = np.array([*area, area[0]]) * (width, height)
        within |= _inside(corners, height, width)
        for begin, end in pairwise(corners):
            steps = 2 + int(np.abs(end - begin).max() * STEPS_PER_PIXEL)
            along = np.linspace(begin, end, steps).astype(int)
            within[along[:, 1].clip(0, height - 1), along[:, 0].clip(0, width - 1)] = True
    beside = covered.copy()
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            beside |= np.roll(covered, (down, across), (0, 1))
    return beside[1:-1, 1:-1]


def _inside(corners: NDArray[np.float64], height: int, width: int) -> NDArray[np.bool_]:
    """Return which pixels' centres a closed polygon winds around, also where its sides cross."""
    across, down = np.arange(width) + 0.5, (np.arange(height) + 0.5)[:, np.newaxis]
    windings = np.zeros((height, width), np.int16)
    for (begin_x, begin_y), (end_x, end_y) in pairwise(corners):
        if begin_y != end_y:
            crossed = (begin_y > down) != (end_y > down)
            right = across < begin_x + (down - begin_y) * (end_x - begin_x) / (end_y - begin_y)
            windings += np.where(crossed & right, 1 if end_y > begin_y else -1, 0).astype(np.int16)
    return np.asarray(windings != 0, np.bool_)
