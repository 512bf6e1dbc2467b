"""CameraInfo: the calibration that maps a camera's pixels to space."""

import math
from collections.abc import Sequence
from typing import Annotated, Final, TypeGuard

import msgspec

from schemas.header import Header, Label

MAX_DISTORTION: Final = 32

SHORTEST: Final = 1e-3
LONGEST: Final = 1e9
"""Maximum focal length in pixels; larger values are garbage."""

Uint32 = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Nine = Annotated[list[float], msgspec.Meta(min_length=9, max_length=9)]
Twelve = Annotated[list[float], msgspec.Meta(min_length=12, max_length=12)]


class Region(msgspec.Struct, frozen=True, kw_only=True):
    """The part of the full image that the camera sends, in pixels; all zeros mean the full image."""

    x_offset: Uint32 = 0
    y_offset: Uint32 = 0
    height: Uint32 = 0
    width: Uint32 = 0
    do_rectify: bool = False


class CameraInfo(msgspec.Struct, frozen=True, kw_only=True):
    """A camera's calibration, as sensor_msgs/CameraInfo defines it; k[0] is 0 where the camera is not calibrated.

    height, width: pixels of the picture that was calibrated. d: distortion, as many numbers as distortion_model has.
    k: 3 x 3 intrinsic matrix, row by row, in pixels. r: 3 x 3 rectification. p: 3 x 4 projection after rectification.
    """

    header: Header
    height: Uint32
    width: Uint32
    distortion_model: Label
    d: Annotated[list[float], msgspec.Meta(max_length=MAX_DISTORTION)]
    k: Nine
    r: Nine
    p: Twelve
    binning_x: Uint32 = 0
    binning_y: Uint32 = 0
    roi: Region = Region()


def is_calibrated(info: CameraInfo | None) -> TypeGuard[CameraInfo]:
    """Return whether there is a camera info with a focal length; uncalibrated drivers send one without."""
    if info is None or not all(map(math.isfinite, info.k)):
        return False
    return all(SHORTEST <= focal <= LONGEST for focal in (info.k[0], info.k[4])) and info.k[6:] == [0, 0, 1]


PLUMB_BOB: Final = "plumb_bob"
RATIONAL: Final = "rational_polynomial"
EQUIDISTANT: Final = frozenset({"equidistant", "fisheye"})

_COUNTS: Final = {PLUMB_BOB: (4, 5), RATIONAL: (4, 5, 8, 12, 14), **dict.fromkeys(EQUIDISTANT, (4,))}
_TILT: Final = 12


def coefficients_of(model: str, d: Sequence[float]) -> tuple[float, ...] | str:
    """Return the coefficients that the model has, none for an ideal lens; or why the distortion is unknown.

    Drivers fill `d` up with noughts, and give no model, or one of any name, to a lens that does not bend. That of an
    equidistant model bends without coefficients too.
    """
    if not all(map(math.isfinite, d)):
        return f"distortion of {model[:64]!r} that is not finite"
    if not any(d):
        return (0.0,) * 4 if model in EQUIDISTANT else ()
    if model not in _COUNTS:
        return f"unknown distortion model {model[:64]!r}"
    fitting = [count for count in _COUNTS[model] if count <= len(d) and not any(d[count:])]
    if not fitting:
        counts = " or ".join(map(str, _COUNTS[model]))
        return f"{len(d)} coefficients for distortion model {model!r}, which has {counts}"
    if any(d[_TILT:]):
        return f"distortion model {model!r} with a tilted sensor"
    return tuple(d[: fitting[-1]])
