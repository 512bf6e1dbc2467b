"""Converts ROS image encodings to the arrays that models expect. Pure."""

from io import BytesIO
from typing import Any, Final

import cv2
import msgspec
import numpy as np
import simplejpeg
from numpy.typing import NDArray
from PIL import Image

from schemas.compression import JPEG, RAW, ZSTD
from schemas.image import BAYER_PATTERNS, BYTES_PER_PIXEL, DEPTH_ENCODINGS, ImageFrame
from services.geometry.decompression import decompressed
from services.geometry.errors import PayloadError

_TO_BGR: Final = {
    "rgb8": cv2.COLOR_RGB2BGR,
    "rgba8": cv2.COLOR_RGBA2BGR,
    "bgra8": cv2.COLOR_BGRA2BGR,
    "mono8": cv2.COLOR_GRAY2BGR,
    "mono16": cv2.COLOR_GRAY2BGR,
    "yuv422": cv2.COLOR_YUV2BGR_UYVY,
    # ROS names a mosaic by its first two pixels of two rows. OpenCV's older names start one pixel further on.
    **{
        f"bayer_{pattern}{bits}": getattr(cv2, f"COLOR_Bayer{pattern.upper()}2BGR")
        for pattern in BAYER_PATTERNS
        for bits in (8, 16)
    },
}
_SIXTEEN_BITS: Final = frozenset({"mono16", *(f"bayer_{pattern}16" for pattern in BAYER_PATTERNS)})
_COLOURS: Final = frozenset({"rgb8", "rgba8"})
_DAMAGE: Final = ("remature end", "bad Huffman code", "bad arithmetic code", "instead of RST")
"""libjpeg's warnings that no intact file causes. Some cameras always write files that it warns about otherwise."""


class ImageDecodeError(ValueError):
    """The data of a compressed image is damaged."""


def shows_colours(frame: ImageFrame) -> bool:
    """Return whether the frame is a colour or grey image, not a depth image."""
    return frame.encoding not in DEPTH_ENCODINGS


def to_bgr(frame: ImageFrame) -> NDArray[np.uint8]:
    """Return an image as a contiguous height x width x 3 array in blue, green, red order.

    BGR is what Ultralytics expects of numpy input (docs.ultralytics.com/modes/predict). 16 bits are scaled to 8.

    Raises:
        ImageDecodeError: a compressed picture that cannot be decoded.
    """
    if frame.format == ZSTD:
        frame = _decompressed(frame)
    pixels = _raw(frame) if frame.format == RAW else _decoded(frame)
    if pixels.dtype == np.uint16:
        pixels = cv2.convertScaleAbs(pixels, alpha=255 / 65535)
    code = None if frame.format != RAW and frame.encoding in _COLOURS else _TO_BGR.get(frame.encoding)
    if code is None:
        return np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(pixels, code), np.uint8)


def small_grey_image(frame: ImageFrame, width: int) -> NDArray[np.uint8]:
    """Return an image in grey, no wider than `width` pixels, as height x width; see `to_bgr`."""
    if frame.format == JPEG and frame.encoding in _COLOURS:
        return _shrunk(_jpeg(frame, "GRAY", min_width=min(width, frame.width)), width)
    return np.asarray(cv2.cvtColor(_shrunk(to_bgr(frame), width), cv2.COLOR_BGR2GRAY), np.uint8)


def _shrunk(pixels: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    scale = min(1.0, width / pixels.shape[1])
    flat = max(scale, 1 / pixels.shape[0])  # a picture has one row at least
    return np.asarray(cv2.resize(pixels, None, fx=scale, fy=flat, interpolation=cv2.INTER_AREA), np.uint8)


def _decompressed(frame: ImageFrame) -> ImageFrame:
    try:
        data = decompressed(frame.data, frame.step * frame.height)
    except PayloadError as error:
        raise ImageDecodeError(str(error)) from error
    return msgspec.structs.replace(frame, format=RAW, data=data)


def _pixels(frame: ImageFrame) -> NDArray[np.uint8]:
    """Return the bytes of each pixel, height x width x bytes, without the rows' padding."""
    size = BYTES_PER_PIXEL[frame.encoding]
    rows = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.step)
    return rows[:, : frame.width * size].reshape(frame.height, frame.width, size)


def _raw(frame: ImageFrame) -> NDArray[Any]:
    pixels = _pixels(frame)
    if frame.encoding not in _SIXTEEN_BITS:
        return pixels
    return pixels.view(">u2" if frame.is_bigendian else "<u2").astype(np.uint16)


def _decoded(frame: ImageFrame) -> NDArray[Any]:
    """Return the pixels of a file: colours in blue, green, red order, anything else unchanged."""
    in_colour = frame.encoding in _COLOURS
    pixels = _jpeg(frame, "BGR" if in_colour else "GRAY") if frame.format == JPEG else _png(frame, in_colour=in_colour)
    if pixels.shape[:2] != (frame.height, frame.width):
        raise ImageDecodeError(f"a {frame.format} that cannot be decoded")
    return pixels


def _jpeg(frame: ImageFrame, colours: str, *, min_width: int = 0) -> NDArray[np.uint8]:
    """Return a JPEG file's pixels, height x width x channels, ignoring its EXIF orientation.

    min_width: pixels that are enough: a smaller picture is less work. 0 for all there are.
    """
    try:
        return np.asarray(simplejpeg.decode_jpeg(frame.data, colorspace=colours, min_width=min_width), np.uint8)
    except ValueError as error:
        if any(sign in str(error) for sign in _DAMAGE):
            raise ImageDecodeError(f"a jpeg that cannot be decoded: {error}") from error
        return _odd_jpeg(frame, in_colour=colours == "BGR")


def _odd_jpeg(frame: ImageFrame, *, in_colour: bool) -> NDArray[np.uint8]:
    """Return the pixels of a file that libjpeg warns about: Pillow ignores warnings, but rejects truncated files."""
    try:
        with Image.open(BytesIO(frame.data), formats=["JPEG"]) as picture:
            if in_colour:
                return np.ascontiguousarray(np.asarray(picture.convert("RGB"))[..., ::-1])
            return np.asarray(picture.convert("L"))[..., None]
    except (OSError, SyntaxError, ValueError) as error:
        raise ImageDecodeError(f"a jpeg that cannot be decoded: {error}") from error


def _png(frame: ImageFrame, *, in_colour: bool) -> NDArray[Any]:
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION if in_colour else cv2.IMREAD_UNCHANGED
    try:
        pixels = cv2.imdecode(np.frombuffer(frame.data, np.uint8), flags)
    except cv2.error as error:
        raise ImageDecodeError(f"a png that cannot be decoded: {error}") from error
    if pixels is None:
        raise ImageDecodeError("a png that cannot be decoded")
    return np.asarray(pixels)
