"""Where a sensor was at its instant, seen from another one at its own. Pure."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.header import Header
from services.geometry.errors import TransformError
from services.geometry.rotation import inverse_of
from services.geometry.transforms import TransformTree

FIXED_FRAMES: Final = ("odom", "map")
"""Frames that stand still, the preferred one first: through them points of one instant are seen at another.

By REP 105 of ROS a robot moves without leaps in odom alone: in map it leaps whenever it is found to be elsewhere.
"""


LITTLE: Final = 2e-3
"""Metres and radians that are no movement: depth itself errs by more, and a pixel is about as wide."""


def between(target: Header, source: Header, tree: TransformTree) -> NDArray[np.float64]:
    """Return the 4 x 4 transform that moves points of one message's frame and stamp into those of another.

    Where no frame that stands still is known at both stamps, nothing is taken to have moved in between.

    Raises:
        TransformError: the one frame is not known from the other.
    """
    moving = _through_fixed(target, source, tree) if target.stamp_ns != source.stamp_ns else None
    try:
        at_rest = tree.lookup(target.frame_id, source.frame_id, source.stamp_ns)
    except TransformError:
        if moving is None:
            raise
        return moving
    return at_rest if moving is None or np.abs(moving - at_rest).max() < LITTLE else moving


def _through_fixed(target: Header, source: Header, tree: TransformTree) -> NDArray[np.float64] | None:
    """Return the transform by way of a frame that is known at both stamps; None if there is none."""
    for fixed in FIXED_FRAMES:
        try:
            there = tree.lookup(fixed, target.frame_id, target.stamp_ns)
            return np.asarray(inverse_of(there) @ tree.lookup(fixed, source.frame_id, source.stamp_ns))
        except TransformError:
            continue
    return None
