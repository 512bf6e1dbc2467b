"""sensor_msgs/CompressedImage to ImageFrame: JPEG and PNG files go on as they are, RVL is decoded."""

import struct
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.ros1.messages import deserialise
from gateway.ros1.subscriber import Message
from gateway.translators.image import checked_color, checked_depth
from gateway.translators.rvl import decode_rvl
from gateway.translators.stream_kind import stamp_of, stamped
from schemas.compression import is_png, picture_of
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import BYTES_PER_PIXEL, DEPTH_ENCODINGS, HELD_AS, ImageFrame

TYPE_NAME: Final = "sensor_msgs/CompressedImage"
COMPRESSED_DEPTH: Final = "compressedDepth"
RVL: Final = "rvl"
_DEPTHS: Final = DEPTH_ENCODINGS | {"mono16"}
_QUANTIZATION: Final = struct.Struct("<iff")
"""Stands before a compressedDepth file."""


def compressed_image(message: Message, header: Header) -> ImageFrame:
    """Translate a JPEG or PNG file, or an RVL image."""
    found: Any = deserialise(TYPE_NAME, message.data)
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
    """Translate a JPEG or PNG file that is no depth."""
    return checked_color(compressed_image(message, header))


def compressed_depth(message: Message, header: Header) -> ImageFrame:
    """Translate a PNG file of depth, with or without what the compressedDepth transport puts before it, or RVL."""
    return checked_depth(compressed_image(message, header))


def _unwrapped(data: memoryview, original: str, transport: str) -> tuple[memoryview, tuple[float, float] | None]:
    """Return a file without what the compressedDepth transport puts before it, and how its metres were quantized.

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
