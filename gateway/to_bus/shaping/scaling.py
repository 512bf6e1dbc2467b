"""Scales images down by whole factors, and their calibration with them. Pure.

Colour is averaged over blocks. Depth is taken from the middle of each block: the mean across an edge is nowhere. Of a
mosaic every n-th cell of 2 x 2 is kept, so that it stays one. Pixels at the right or bottom that fill no block are cut
off.
"""

from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo
from schemas.compression import RAW
from schemas.image import BYTES_PER_PIXEL, DEPTH_ENCODINGS, ImageFrame

_CHANNELS: Final = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "yuv422": 2}


def pixels_of(frame: ImageFrame) -> NDArray[Any]:
    """Return a view of a raw frame's pixels, height x width x channels, in the frame's byte order."""
    size = BYTES_PER_PIXEL[frame.encoding]
    rows = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.step)
    pixels = rows[:, : frame.width * size].reshape(frame.height, frame.width, size)
    if frame.encoding in _CHANNELS or size == 1:
        return pixels
    order = ">" if frame.is_bigendian else "<"
    return pixels.view(f"{order}f4" if frame.encoding == "32FC1" else f"{order}u2")


def with_pixels(frame: ImageFrame, pixels: NDArray[Any]) -> ImageFrame:
    """Return the frame with new pixels of the same type, rows without padding."""
    height, width = pixels.shape[:2]
    packed: Any = np.ascontiguousarray(pixels)
    return msgspec.structs.replace(
        frame,
        height=height,
        width=width,
        step=width * BYTES_PER_PIXEL[frame.encoding],
        data=memoryview(packed.reshape(-1).view(np.uint8)),
    )


MAX_FACTOR: Final = 16


class ShapingError(ValueError):
    """A frame that cannot be scaled as the settings say; the message names the cause."""


def scale_image(frame: ImageFrame, factor: int) -> ImageFrame:
    """Return the frame at 1 / factor of its size.

    Raises:
        ShapingError: it is compressed already, or too small.
    """
    if frame.format != RAW:
        raise ShapingError(f"a {frame.format} that arrived as one cannot be scaled: use the raw topic, or set no scale")
    pixels = pixels_of(frame)
    if frame.encoding in DEPTH_ENCODINGS:
        made = _middles(pixels, factor)
    elif frame.encoding.startswith("bayer_"):
        made = _cells(pixels, factor)
    elif frame.encoding == "yuv422":
        made = _uyvy(pixels, factor)
    else:
        made = _averages(pixels, factor)
    if not made.size:
        raise ShapingError(f"{frame.width}x{frame.height} pixels are too few to be scaled by 1/{factor}")
    return with_pixels(frame, made)


def _middles(pixels: NDArray[Any], factor: int) -> NDArray[Any]:
    height, width = pixels.shape[0] // factor, pixels.shape[1] // factor
    middle = _middle(factor)
    return pixels[middle::factor, middle::factor][:height, :width]


def _middle(factor: int) -> int:
    return (factor - 1) // 2


def _cells(pixels: NDArray[Any], factor: int) -> NDArray[Any]:
    height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
    cells = pixels[: height * 2, : width * 2].reshape(height, 2, width, 2)
    kept = cells[_middle(factor) :: factor, :, _middle(factor) :: factor][: height // factor, :, : width // factor]
    return kept.reshape(kept.shape[0] * 2, kept.shape[2] * 2, 1)


def _uyvy(pixels: NDArray[Any], factor: int) -> NDArray[Any]:
    """Scale luma and the two chroma channels, shared by pairs of pixels, separately."""
    colours = [_averages(pixels[:, place::2, 0], factor) for place in (0, 1)]
    height, pairs = colours[0].shape
    made = np.empty((height, pairs * 2, 2), np.uint8)
    made[..., 1] = _averages(pixels[..., 1], factor)[:, : pairs * 2]
    for place, colour in enumerate(colours):
        made[:, place::2, 0] = colour
    return made


def _averages(pixels: NDArray[Any], factor: int) -> NDArray[Any]:
    height, width = pixels.shape[0] // factor, pixels.shape[1] // factor
    whole = pixels[: height * factor, : width * factor]
    wide: Any = np.uint16 if pixels.dtype.itemsize == 1 else np.uint32  # MAX_FACTOR ** 2 times 255 fits 16 bits
    rows: NDArray[np.uint32] = whole[0::factor].astype(wide)
    for place in range(1, factor):
        rows += whole[place::factor]
    total = rows[:, 0::factor].copy()
    for place in range(1, factor):
        total += rows[:, place::factor]
    return ((total + factor**2 // 2) // factor**2).astype(pixels.dtype)


def scale_info(info: CameraInfo, factor: int, *, depth: bool) -> CameraInfo:
    """Return the calibration of the scaled image, exact for averaged colour or, with `depth`, for depth.

    Binning stays the camera's own: k, p, size and region are those of a camera that bins as before and sees less sharp.
    """
    bin_x, bin_y = max(info.binning_x, 1), max(info.binning_y, 1)
    roi = msgspec.structs.replace(
        info.roi,
        x_offset=info.roi.x_offset // factor,
        y_offset=info.roi.y_offset // factor,
        width=_binned(info.roi.width, bin_x, factor),
        height=_binned(info.roi.height, bin_y, factor),
    )
    centre = _middle(factor) if depth else (factor - 1) / 2
    move_x = roi.x_offset - (info.roi.x_offset + bin_x * centre) / factor
    move_y = roi.y_offset - (info.roi.y_offset + bin_y * centre) / factor
    return msgspec.structs.replace(
        info,
        width=_binned(info.width, bin_x, factor),
        height=_binned(info.height, bin_y, factor),
        k=_projected(info.k, 3, factor, move_x, move_y),
        p=_projected(info.p, 4, factor, move_x, move_y),
        roi=roi,
    )


def _binned(size: int, binning: int, factor: int) -> int:
    """Return the unbinned size for which the scaled image has whole pixels."""
    return size // binning // factor * binning


def _projected(matrix: list[float], columns: int, factor: int, move_x: float, move_y: float) -> list[float]:
    """Scale and shift the first two rows of a projection; all zeros stand for an unknown one."""
    if not any(matrix):
        return matrix
    made = np.array(matrix, np.float64).reshape(3, columns)
    made[:2] /= factor
    made[:2] += np.outer((move_x, move_y), made[2])
    return [float(value) for value in made.ravel()]
