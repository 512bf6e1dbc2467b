"""Transforms: the poses of frames of reference relative to others."""

from typing import Annotated, Final

import msgspec

from schemas.header import Header, Label, Nanoseconds

MAX_TRANSFORMS: Final = 4_096


class Transform(msgspec.Struct, frozen=True, kw_only=True):
    """The pose of child_frame_id in frame_id at stamp_ns. As sent: a rotation of length 0 or a NaN is the sender's.

    translation: x, y, z in metres. rotation: quaternion x, y, z, w.
    """

    frame_id: Label
    child_frame_id: Label
    stamp_ns: Nanoseconds
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class Transforms(msgspec.Struct, frozen=True, kw_only=True):
    """Some transforms of one robot: on `tf` those of one ROS message, on `tf_static` all known ones, one per child.

    The header's stamp_ns is 0: each transform has its own.
    """

    header: Header
    transforms: Annotated[list[Transform], msgspec.Meta(max_length=MAX_TRANSFORMS)]
