"""sensor_msgs/PointCloud2 without copying its points."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from gateway.ros1.errors import MessageError
from gateway.ros1.wire.text import encode_text, read_text

TYPE_NAME = "sensor_msgs/PointCloud2"
MAX_FIELDS = 64
_HEAD = struct.Struct("<IIII")
_SIZE = struct.Struct("<III")
_LENGTH = struct.Struct("<I")
_FIELD = struct.Struct("<IBI")
_LAYOUT = struct.Struct("<?III")


@dataclass(frozen=True, slots=True)
class PointField:
    """`count` values of a numbered type at `offset` bytes into each point."""

    name: str
    offset: int
    datatype: int
    count: int


@dataclass(frozen=True, slots=True)
class PointCloud:
    """One cloud; `data` holds `height` rows of `row_step` bytes, if the sender was honest: check before use."""

    stamp: int
    frame_id: str
    height: int
    width: int
    fields: tuple[PointField, ...]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: memoryview
    is_dense: bool


def decode_point_cloud(message: bytes | bytearray | memoryview) -> PointCloud:
    """Return the cloud; `data` is a view into the message, the stamp is in nanoseconds.

    Raises:
        MessageError: not a serialised sensor_msgs/PointCloud2.

    """
    view = memoryview(message)
    try:
        return _decode(view)
    except struct.error as error:
        raise MessageError(f"{len(view)} bytes are not a {TYPE_NAME}: {error}") from error


def _decode(view: memoryview) -> PointCloud:
    _, secs, nsecs, length = _HEAD.unpack_from(view)
    frame_id, at = read_text(TYPE_NAME, view, _HEAD.size, length)
    height, width, count = _SIZE.unpack_from(view, at)
    fields, at = _fields(view, at + _SIZE.size, count)
    bigendian, point_step, row_step, length = _LAYOUT.unpack_from(view, at)
    at += _LAYOUT.size
    if len(view) - at - 1 != length:
        raise MessageError(f"{TYPE_NAME} announces {length} bytes of points and holds {len(view) - at - 1}")
    stamp = secs * 1_000_000_000 + nsecs
    return PointCloud(
        stamp, frame_id, height, width, fields, bigendian, point_step, row_step, view[at:-1], is_dense=bool(view[-1])
    )


def encode_point_cloud(cloud: PointCloud, *, seq: int) -> bytes:
    """Return the serialised message; `seq` is the header's.

    Raises:
        MessageError: a number does not fit its field, or a text is too long or no text.

    """
    try:
        frame_id = encode_text(TYPE_NAME, cloud.frame_id)
        parts = (
            _HEAD.pack(seq, *divmod(cloud.stamp, 1_000_000_000), len(frame_id)),
            frame_id,
            _SIZE.pack(cloud.height, cloud.width, len(cloud.fields)),
            *(_encoded_field(field) for field in cloud.fields),
            _LAYOUT.pack(cloud.is_bigendian, cloud.point_step, cloud.row_step, cloud.data.nbytes),
            cloud.data,
            b"\1" if cloud.is_dense else b"\0",
        )
    except (struct.error, UnicodeEncodeError) as error:
        raise MessageError(f"cannot serialise a {TYPE_NAME}: {error}") from error
    return b"".join(parts)


def _encoded_field(field: PointField) -> bytes:
    name = encode_text(TYPE_NAME, field.name)
    return _LENGTH.pack(len(name)) + name + _FIELD.pack(field.offset, field.datatype, field.count)


def _fields(view: memoryview, at: int, count: int) -> tuple[tuple[PointField, ...], int]:
    if count > MAX_FIELDS:
        raise MessageError(f"{TYPE_NAME} with {count} fields")
    fields = []
    for _ in range(count):
        (length,) = _LENGTH.unpack_from(view, at)
        name, at = read_text(TYPE_NAME, view, at + _LENGTH.size, length)
        fields.append(PointField(name, *_FIELD.unpack_from(view, at)))
        at += _FIELD.size
    return tuple(fields), at
