"""sensor_msgs/CompressedImage to ImageFrame: the file goes on as it is, nothing is decoded here."""

import struct
from typing import Any, Final

import msgspec

from gateway.ros1.messages import deserialise
from gateway.ros1.subscriber import Message
from gateway.translators.image import checked_color, checked_depth
from gateway.translators.stream_kind import stamp_of, stamped
from schemas.compression import picture_of
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import BYTES_PER_PIXEL, DEPTH_ENCODINGS, HELD_AS, ImageFrame

TYPE_NAME: Final = "sensor_msgs/CompressedImage"
COMPRESSED_DEPTH: Final = "compressedDepth"
_DEPTHS: Final = DEPTH_ENCODINGS | {"mono16"}
_QUANTIZATION: Final = struct.Struct("<iff")


def compressed_image(message: Message, header: Header) -> ImageFrame:
    """Translate a JPEG or PNG file."""
    found: Any = deserialise(TYPE_NAME, message.data)
    original, _, transport = (part.strip() for part in found.format.partition(";"))
    data, inverse_depth = memoryview(found.data), None
    if COMPRESSED_DEPTH in transport:
        inverse_depth = _inverse_depth(original, data)
        data = data[_QUANTIZATION.size :]
    picture = picture_of(data)
    encoding = original if original in HELD_AS[picture.encoding] else picture.encoding
    return ImageFrame(
        header=stamped(header, stamp_of(found.header), found.header.frame_id),
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
    """Translate a PNG file of depth, with or without what the compressedDepth transport puts before it."""
    frame = compressed_image(message, header)
    if frame.encoding == "mono16":  # not every driver says what its file is made of
        frame = msgspec.structs.replace(frame, encoding="16UC1")
    return checked_depth(frame)


def _inverse_depth(original: str, data: memoryview) -> tuple[float, float] | None:
    """Return the quantization of metres that stands before the file; millimetres have none."""
    if len(data) < _QUANTIZATION.size:
        raise SchemaError(f"{COMPRESSED_DEPTH} of {len(data)} bytes")
    if original not in _DEPTHS:
        raise SchemaError(f"{COMPRESSED_DEPTH} of {original[:32]!r}")
    _, a, b = _QUANTIZATION.unpack_from(data)
    return (a, b) if original == "32FC1" else None
