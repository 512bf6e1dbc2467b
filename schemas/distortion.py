"""Which lenses of a CameraInfo are understood: the distortion models of sensor_msgs/distortion_models.h."""

import math
from collections.abc import Sequence
from typing import Final

PLUMB_BOB: Final = "plumb_bob"
RATIONAL: Final = "rational_polynomial"
EQUIDISTANT: Final = frozenset({"equidistant", "fisheye"})

_COUNTS: Final = {PLUMB_BOB: (4, 5), RATIONAL: (4, 5, 8, 12, 14), **dict.fromkeys(EQUIDISTANT, (4,))}
_TILT: Final = 12


def coefficients_of(model: str, d: Sequence[float]) -> tuple[float, ...] | str:
    """Return as many coefficients as the model has, none of a lens that does not bend; or why the lens is not known.

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
