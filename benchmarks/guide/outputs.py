"""The topics that a whole set of outputs is on, and what their messages say of when it is. Pure."""

import struct
from collections.abc import Mapping
from typing import Final

from benchmarks.guide.topics import CLASSES, DETECTION, DISTANCE, OBJECTS_SHOWN, SEGMENTATION
from gateway.ros1 import image, point_cloud
from gateway.to_ros.outputs import STRING

OBJECTS: Final = "/ultralytics/segmentation/points"

COMMON: Final[Mapping[str, str]] = {
    DETECTION: image.TYPE_NAME,
    SEGMENTATION: image.TYPE_NAME,
    CLASSES: STRING,
    DISTANCE: STRING,
}
GUIDE: Final[Mapping[str, str]] = {**COMMON, OBJECTS_SHOWN: STRING}
FLEETSIGHT: Final[Mapping[str, str]] = {**COMMON, OBJECTS: point_cloud.TYPE_NAME}
"""The types of a whole set of outputs, by topic."""

_STAMP: Final = struct.Struct("<II")
_AFTER_SEQ: Final = 4


def stamp_ns(type_name: str, message: bytes | bytearray | memoryview) -> int:
    """Return the stamp of a serialised message's header; 0 where its type has none."""
    if type_name == STRING:
        return 0
    secs, nsecs = _STAMP.unpack_from(message, _AFTER_SEQ)
    return int(secs * 1_000_000_000 + nsecs)


def stamped(message: bytes, stamp_ns: int) -> bytes:
    """Return a serialised message that begins with a header with another stamp."""
    stamp = _STAMP.pack(*divmod(stamp_ns, 1_000_000_000))
    return b"".join((message[:_AFTER_SEQ], stamp, memoryview(message)[_AFTER_SEQ + _STAMP.size :]))
