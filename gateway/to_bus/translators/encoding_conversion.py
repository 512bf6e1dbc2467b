"""Converts images from encodings that the contract does not carry to ones that it does.

The names are those of sensor_msgs/image_encodings.h, of OpenCV's types and of Linux's video formats.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.ros1.image import Image
from schemas.errors import SchemaError
from schemas.image import check_rows

OTHER_NAMES: Final = {
    "8UC1": "mono8",
    "8UC3": "bgr8",
    "8UC4": "bgra8",
    "16UC3": "bgr16",
    "16UC4": "bgra16",
    "uyvy": "yuv422",
    "UYVY": "yuv422",
    "yuyv": "yuv422_yuy2",
    "YUYV": "yuv422_yuy2",
    "YUY2": "yuv422_yuy2",
    "NV12": "nv12",
    "NV21": "nv21",
}
"""Aliases of encodings. OpenCV's types, cv_bridge's default, stand for the encodings as which ROS shows them."""

AS_DEPTH: Final = {"16SC1": "16UC1", "64FC1": "32FC1"}
"""Encodings that are converted to depth encodings."""


def carried(image: Image) -> Image:
    """Return the image in an encoding that the contract carries; unchanged if it has one already.

    16-bit colours become 8-bit ones, every kind of YUV `yuv422`, signed millimetres 16UC1, and 64-bit metres 32FC1.

    Raises:
        SchemaError: the image has to be converted, and its data does not fit its dimensions.
    """
    image = image._replace(encoding=OTHER_NAMES.get(image.encoding, image.encoding))
    convert = CONVERTERS.get(image.encoding)
    return image if convert is None else convert(image)


def _with_pixels(image: Image, encoding: str, pixels: NDArray[Any]) -> Image:
    """Return the image with new pixels, height x bytes."""
    height, step = pixels.shape
    data = memoryview(np.ascontiguousarray(pixels).reshape(-1))  # type: ignore[arg-type]
    return image._replace(height=height, encoding=encoding, is_bigendian=False, step=step, data=data)


def _rows(image: Image, pixel: int) -> NDArray[np.uint8]:
    """Return the rows of pixels, height x bytes, without padding."""
    row = image.width * pixel
    check_rows(image.height, image.width, row, image.step, image.data.nbytes, encoding=image.encoding)
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, :row]


def _numbers(image: Image, kind: str, channels: int = 1) -> NDArray[Any]:
    rows = _rows(image, channels * np.dtype(kind).itemsize)
    return rows.view(f"{'>' if image.is_bigendian else '<'}{kind}")


def _eight_bits(image: Image, *, encoding: str, channels: int) -> Image:
    """Scale 16 bits to 8 and round, as cv_bridge does."""
    scaled = (_numbers(image, "u2", channels).astype(np.uint32) * 255 + 32_895) >> 16  # divides by 257
    return _with_pixels(image, encoding, scaled.astype(np.uint8))


def _yuyv(image: Image) -> Image:
    """Convert YUYV to UYVY: chroma before luma of each pixel."""
    rows = np.ascontiguousarray(_rows(image, 2))
    return _with_pixels(image, "yuv422", rows.view(np.uint16).byteswap().view(np.uint8))


def _semi_planar(image: Image, *, red_first: bool) -> Image:
    """Convert NV12 or NV21 to UYVY: the chroma of each block of 2 x 2 pixels goes to both of its rows."""
    pitch, height = _planes(image)
    width = image.width
    planes = np.frombuffer(image.data, np.uint8).reshape(-1, pitch)[:, :width]
    colours = planes[height:]
    if red_first:
        colours = np.ascontiguousarray(colours).view(np.uint16).byteswap().view(np.uint8)
    made = np.empty((height, width, 2), np.uint8)
    made[..., 0] = np.repeat(colours, 2, axis=0)
    made[..., 1] = planes[:height]
    return _with_pixels(image, "yuv422", made.reshape(height, -1))


def _planes(image: Image) -> tuple[int, int]:
    """Return the bytes of a row and the height in pixels of an image with 1.5 times as many rows of data.

    Some drivers give these rows as the height; some count one and a half bytes for each pixel of a row.
    """
    height, width, step, size = image.height, image.width, image.step, image.data.nbytes
    found = next(
        (
            (pitch, rows * 2 // 3)
            for pitch, rows in ((width, height * 3 // 2), (step, height * 3 // 2), (step, height))
            if size == pitch * rows and not rows % 3
        ),
        None,
    )
    if found is None:
        raise SchemaError(f"data does not fit: {size} bytes of {width}x{height} {image.encoding} pixels, step {step}")
    pitch, pixels_high = found
    check_rows(pixels_high, width, width, pitch, pitch * pixels_high, encoding=image.encoding)
    if width % 2:
        raise SchemaError(f"{image.encoding} pixels come in blocks of 2 x 2, and a row has {width}")
    return pitch, pixels_high


def _unsigned(image: Image) -> Image:
    return _with_pixels(image, "16UC1", np.maximum(_numbers(image, "i2"), 0).astype("<u2").view(np.uint8))


def _single_precision(image: Image) -> Image:
    with np.errstate(over="ignore", invalid="ignore"):
        return _with_pixels(image, "32FC1", _numbers(image, "f8").astype("<f4").view(np.uint8))


CONVERTERS: Final[Mapping[str, Callable[[Image], Image]]] = {
    "rgb16": partial(_eight_bits, encoding="rgb8", channels=3),
    "bgr16": partial(_eight_bits, encoding="bgr8", channels=3),
    "rgba16": partial(_eight_bits, encoding="rgba8", channels=4),
    "bgra16": partial(_eight_bits, encoding="bgra8", channels=4),
    "yuv422_yuy2": _yuyv,
    "nv12": partial(_semi_planar, red_first=False),
    "nv21": partial(_semi_planar, red_first=True),
    "16SC1": _unsigned,
    "64FC1": _single_precision,
}
"""Conversion functions by encoding."""
