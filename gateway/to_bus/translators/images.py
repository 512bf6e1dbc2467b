"""sensor_msgs/Image, sensor_msgs/CompressedImage and stereo_msgs/DisparityImage to ImageFrame."""

import math
import struct
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.ros1.image import decode_image
from gateway.ros1.messages import deserialise
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.translators.encoding_conversion import carried
from gateway.to_bus.translators.rvl import decode_rvl
from gateway.to_bus.translators.stream_kind import stamp_of, stamped
from schemas.compression import is_png, picture_of
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import BYTES_PER_PIXEL, DEPTH_ENCODINGS, HELD_AS, ImageFrame, check_layout


def image(message: Message, header: Header) -> ImageFrame:
    """Translate an image of any encoding."""
    found = carried(decode_image(message.data))
    return ImageFrame(
        header=stamped(header, found.stamp, found.frame_id),
        height=found.height,
        width=found.width,
        encoding=found.encoding,
        step=found.step,
        data=found.data,
        is_bigendian=found.is_bigendian,
    )


NOT_COLOR: Final = "pixels are depth, not colour"


def color(message: Message, header: Header) -> ImageFrame:
    """Translate a colour image; depth is refused."""
    return checked_color(image(message, header))


def checked_color(frame: ImageFrame) -> ImageFrame:
    """Return the frame.

    Raises:
        SchemaError: its encoding is one of depth.

    """
    if frame.encoding in DEPTH_ENCODINGS:
        raise SchemaError(f"{frame.encoding} {NOT_COLOR}")
    return frame


def depth(message: Message, header: Header) -> ImageFrame:
    """Translate a depth image."""
    return checked_depth(image(message, header))


def checked_depth(frame: ImageFrame) -> ImageFrame:
    """Return the frame if it is depth; 16-bit grey counts as millimetres, whatever the driver calls it.

    Raises:
        SchemaError: its encoding is none of depth.

    """
    if frame.encoding == "mono16":
        return msgspec.structs.replace(frame, encoding="16UC1")
    if frame.encoding not in DEPTH_ENCODINGS:
        raise SchemaError(f"{frame.encoding} is not a depth encoding: use {' or '.join(sorted(DEPTH_ENCODINGS))}")
    return frame


DISPARITY_TYPE: Final = "stereo_msgs/DisparityImage"
DEPTH: Final = "32FC1"


def disparity(message: Message, header: Header) -> ImageFrame:
    """Translate disparities in pixels to distances in metres, NaN where there is no valid disparity above 0.

    Invalid is what lies below the message's `min_disparity`: stereo_image_proc marks pixels without a match so.
    """
    found: Any = deserialise(DISPARITY_TYPE, message.data)
    image, reach = found.image, found.f * found.T
    if image.encoding != DEPTH:
        raise SchemaError(f"disparity as {image.encoding[:32]!r} instead of {DEPTH}")
    if not (math.isfinite(reach) and reach > 0):
        raise SchemaError(f"disparity of cameras with f = {found.f} pixels, T = {found.T} m")
    check_layout(image.height, image.width, image.encoding, image.step, image.data.nbytes)
    rows = image.data.reshape(image.height, image.step)[:, : image.width * 4]
    pixels = np.ascontiguousarray(rows).view(">f4" if image.is_bigendian else "<f4")
    depth = _disparity_metres(pixels, reach, found.min_disparity)
    return ImageFrame(
        header=stamped(header, stamp_of(found.header), found.header.frame_id),
        height=image.height,
        width=image.width,
        encoding=DEPTH,
        step=image.width * 4,
        data=depth.data.cast("B"),
    )


def _disparity_metres(disparity: NDArray[np.float32], reach: float, least: float) -> NDArray[np.float32]:
    """Return depth in metres. least: the least valid disparity in pixels; NaN sets no limit."""
    with np.errstate(all="ignore"):
        depth = (np.float32(reach) / disparity).astype("<f4")
        depth[~((disparity > 0) & (depth > 0) & np.isfinite(depth)) | (disparity < least)] = np.nan
    return depth


COMPRESSED_TYPE: Final = "sensor_msgs/CompressedImage"
COMPRESSED_DEPTH: Final = "compressedDepth"
RVL: Final = "rvl"
_DEPTHS: Final = DEPTH_ENCODINGS | {"mono16"}
_QUANTIZATION: Final = struct.Struct("<iff")
"""Header before a compressedDepth file."""


def compressed_image(message: Message, header: Header) -> ImageFrame:
    """Translate a JPEG or PNG file, or an RVL image."""
    found: Any = deserialise(COMPRESSED_TYPE, message.data)
    header = stamped(header, stamp_of(found.header), found.header.frame_id)
    original, _, transport = (part.strip() for part in found.format.partition(";"))
    data, inverse_depth = _unwrapped(memoryview(found.data), original, transport)
    if RVL in transport.split() and not is_png(data):
        return _of_rvl(header, data, inverse_depth)
    picture = picture_of(data)
    encoding = original if original in HELD_AS[picture.encoding] else picture.encoding
    return ImageFrame(
        header=header,
        height=picture.height,
        width=picture.width,
        encoding=encoding,
        step=picture.width * BYTES_PER_PIXEL[encoding],
        data=data,
        format=picture.format,
        inverse_depth=inverse_depth,
    )


def compressed_color(message: Message, header: Header) -> ImageFrame:
    """Translate a JPEG or PNG file of colour; depth is refused."""
    return checked_color(compressed_image(message, header))


def compressed_depth(message: Message, header: Header) -> ImageFrame:
    """Translate depth as a PNG file, with or without the compressedDepth transport's header, or as RVL."""
    return checked_depth(compressed_image(message, header))


def _unwrapped(data: memoryview, original: str, transport: str) -> tuple[memoryview, tuple[float, float] | None]:
    """Return a file without the compressedDepth transport's header, and the quantization of its metres.

    Some drivers name that transport and leave this out, others put it before a file of another name: where a PNG file
    begins is certain.
    """
    if is_png(data):
        if original == "32FC1":
            raise SchemaError("a PNG file of 32FC1 that does not say how its metres were quantized")
        return data, None
    rest = data[_QUANTIZATION.size :]
    if COMPRESSED_DEPTH in transport:
        if len(data) < _QUANTIZATION.size:
            raise SchemaError(f"{COMPRESSED_DEPTH} of {len(data)} bytes")
        if original not in _DEPTHS:
            raise SchemaError(f"{COMPRESSED_DEPTH} of {original[:32]!r}")
    elif not is_png(rest):
        return data, None
    _, a, b = _QUANTIZATION.unpack_from(data)
    return rest, (a, b) if original == "32FC1" else None


def _of_rvl(header: Header, data: memoryview, inverse_depth: tuple[float, float] | None) -> ImageFrame:
    numbers = decode_rvl(data)
    height, width = numbers.shape
    encoding = "16UC1" if inverse_depth is None else "32FC1"
    pixels = numbers.astype("<u2") if inverse_depth is None else _metres(numbers, *inverse_depth)
    return ImageFrame(
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        step=width * BYTES_PER_PIXEL[encoding],
        data=pixels.data.cast("B"),
    )


def _metres(numbers: NDArray[np.uint16], a: float, b: float) -> NDArray[np.float32]:
    with np.errstate(all="ignore"):
        metres = (a / (numbers.astype(np.float64) - b)).astype("<f4")
    metres[numbers == 0] = np.nan
    return metres
