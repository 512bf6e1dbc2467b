"""sensor_msgs/Image without copying its pixels: the gateway's hot path. Pure."""

from __future__ import annotations

import struct
from typing import NamedTuple

from gateway.ros1.errors import MessageError
from gateway.ros1.wire.text import encode_text, read_text

TYPE_NAME = "sensor_msgs/Image"
_HEAD = struct.Struct("<IIII")
_SIZE = struct.Struct("<II")
_ROW = struct.Struct("<BI")
_LENGTH = struct.Struct("<I")


class Image(NamedTuple):
    """One image; `data` holds `height` rows of `step` bytes, if the sender was honest: check before use."""

    seq: int
    stamp_s: int
    stamp_ns: int
    frame_id: str
    height: int
    width: int
    encoding: str
    is_bigendian: bool
    step: int
    data: memoryview

    @property
    def stamp(self) -> int:
        """The sensor's time in nanoseconds."""
        return self.stamp_s * 1_000_000_000 + self.stamp_ns


def decode_image(message: bytes | bytearray | memoryview) -> Image:
    """Return the image; `data` is a view into the message.

    Raises:
        MessageError: not a serialised sensor_msgs/Image.

    """
    view = memoryview(message)
    try:
        seq, secs, nsecs, length = _HEAD.unpack_from(view)
        frame_id, at = read_text(TYPE_NAME, view, _HEAD.size, length)
        height, width = _SIZE.unpack_from(view, at)
        (length,) = _LENGTH.unpack_from(view, at + _SIZE.size)
        encoding, at = read_text(TYPE_NAME, view, at + _SIZE.size + _LENGTH.size, length)
        bigendian, step = _ROW.unpack_from(view, at)
        (length,) = _LENGTH.unpack_from(view, at + _ROW.size)
    except struct.error as error:
        raise MessageError(f"{len(view)} bytes are not a {TYPE_NAME}: {error}") from error
    data = view[at + _ROW.size + _LENGTH.size :]
    if len(data) != length:
        raise MessageError(f"{TYPE_NAME} announces {length} bytes of pixels and holds {len(data)}")
    return Image(seq, secs, nsecs, frame_id, height, width, encoding, bool(bigendian), step, data)


def encode_image(image: Image) -> bytes:
    """Return the serialised message.

    Raises:
        MessageError: a number does not fit its field, or a text is too long or no text.

    """
    try:
        frame_id, encoding = encode_text(TYPE_NAME, image.frame_id), encode_text(TYPE_NAME, image.encoding)
        parts = (
            _HEAD.pack(image.seq, image.stamp_s, image.stamp_ns, len(frame_id)),
            frame_id,
            _SIZE.pack(image.height, image.width),
            _LENGTH.pack(len(encoding)),
            encoding,
            _ROW.pack(image.is_bigendian, image.step),
            _LENGTH.pack(image.data.nbytes),
        )
    except (struct.error, UnicodeEncodeError) as error:
        raise MessageError(f"cannot serialise a {TYPE_NAME}: {error}") from error
    return b"".join((*parts, image.data))
