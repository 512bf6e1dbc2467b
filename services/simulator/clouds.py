"""Point clouds as arrays of points: a camera's coloured ones, a lidar's with their rings. Pure."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.placement import Placement
from services.simulator.world import Camera, Turn, as_32fc1, organised_cloud

COLORED: Final = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<f4")])
"""`rgb` as PCL packs it: 0x00RRGGBB called a float."""
RINGED: Final = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")]
)
"""The fields of Velodyne's driver. `time` is 0: a simulated turn is measured at once."""
WHITE: Final = 0xFFFFFF


def colored_points(metres: NDArray[np.float32], camera: Camera, rgb: NDArray[np.uint32]) -> NDArray[Any]:
    """Return the organised points (height, width) of depth (0 or NaN for none), with packed colours of that shape."""
    points = np.empty(metres.shape, COLORED)
    xyz = organised_cloud(metres, camera)
    for axis, name in enumerate("xyz"):
        points[name] = xyz[..., axis]
    points["rgb"] = rgb.view(np.float32)
    return points


def packed(picture: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Return 0x00RRGGBB (height, width) of RGB (height, width, 3)."""
    wide = picture.astype(np.uint32)
    return np.asarray(wide[..., 0] << 16 | wide[..., 1] << 8 | wide[..., 2])


def projected(
    rgb: NDArray[np.uint32], color: Camera, metres: NDArray[np.float32], camera: Camera, placement: Placement
) -> NDArray[np.uint32]:
    """Return for each pixel of depth the packed colour that is seen there, white outside the picture.

    placement: where the depth camera's optical frame is in the colour camera's.
    """
    xyz = organised_cloud(metres, camera) @ placement[:3, :3].T.astype(np.float32) + placement[:3, 3].astype(np.float32)
    with np.errstate(invalid="ignore"):
        column = np.rint(xyz[..., 0] / xyz[..., 2] * color.fx + color.cx)
        row = np.rint(xyz[..., 1] / xyz[..., 2] * color.fy + color.cy)
        inside = (column >= 0) & (column < color.width) & (row >= 0) & (row < color.height) & (xyz[..., 2] > 0)
    found = np.full(metres.shape, WHITE, np.uint32)
    found[inside] = rgb[row[inside].astype(np.intp), column[inside].astype(np.intp)]
    return found


def ringed_points(turn: Turn) -> NDArray[Any]:
    """Return the points (1, n) of a lidar's turn."""
    points = np.zeros((1, len(turn.ring)), RINGED)
    for axis, name in enumerate("xyz"):
        points[name] = turn.xyz[:, axis]
    points["intensity"] = turn.intensity
    points["ring"] = turn.ring
    return points


def metres(depth: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return depth in metres, NaN where there is none, of whole millimetres, 0 for none."""
    return as_32fc1(depth.astype(np.float32) / np.float32(1000))
