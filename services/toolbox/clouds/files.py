"""Encodes ObjectClouds as PLY and PCD files, binary and little-endian. Pure."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.objects import ObjectClouds

WHITE: Final = 255

POINT: Final = np.dtype([("xyz", "<f4", (3,)), ("rgb", "u1", (3,)), ("label", "<u4"), ("instance", "<u4")])
"""A point as PLY files hold it here."""

_PCD_POINT: Final = np.dtype(
    {
        "names": ["xyz", "bgr", "label", "instance"],
        "formats": [("<f4", (3,)), ("u1", (3,)), "<u4", "<u4"],
        "offsets": [0, 12, 16, 20],
        "itemsize": 24,
    }
)

_PLY: Final = """ply
format binary_little_endian 1.0
comment frame {frame}, stamp {stamp} ns
element vertex {count}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
property int label
property int instance
end_header
"""

_PCD: Final = """# .PCD v0.7
VERSION 0.7
FIELDS x y z rgb label instance
SIZE 4 4 4 4 4 4
TYPE F F F F U U
COUNT 1 1 1 1 1 1
WIDTH {count}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {count}
DATA binary
"""


def points_of(seen: ObjectClouds) -> NDArray[np.void]:
    """Return the points of all objects in the sensor's frame, with class and object; white if colourless."""
    points = np.zeros(sum(each.count for each in seen.objects), POINT)
    at = 0
    for each in seen.objects:
        some = points[at : at + each.count]
        some["xyz"] = np.frombuffer(each.xyz, "<f4").reshape(-1, 3)
        some["rgb"] = np.frombuffer(each.rgb, np.uint8).reshape(-1, 3) if each.rgb.nbytes else WHITE
        some["label"], some["instance"] = each.label, each.index
        at += each.count
    return points


def ply(seen: ObjectClouds) -> bytes:
    """Return a PLY file; label is the model's class index, instance the object's index in the Detections.

    Both are called `int`, since Open3D reads no `uint`: a label of 2**31 or more is negative there.
    """
    points = points_of(seen)
    frame = "".join(letter if letter.isprintable() and letter.isascii() else "?" for letter in seen.header.frame_id)
    return _PLY.format(frame=frame, stamp=seen.header.stamp_ns, count=len(points)).encode() + points.tobytes()


def pcd(seen: ObjectClouds) -> bytes:
    """Return a PCD file; rgb is packed as PCL does, 0x00RRGGBB called a float."""
    points = points_of(seen)
    packed = np.zeros(len(points), _PCD_POINT)
    packed["xyz"], packed["bgr"] = points["xyz"], points["rgb"][:, ::-1]
    packed["label"], packed["instance"] = points["label"], points["instance"]
    return _PCD.format(count=len(points)).encode() + packed.tobytes()
