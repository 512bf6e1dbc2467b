"""ObjectClouds to sensor_msgs/PointCloud2: one cloud of all objects."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.ros1.point_cloud import PointCloud, PointField, encode_point_cloud
from schemas.objects import ObjectCloud, ObjectClouds

UINT32: Final = 6
FLOAT32: Final = 7
WHITE: Final = 255

POINT: Final = np.dtype(
    {
        "names": ["xyz", "bgr", "label", "instance"],
        "formats": [("<f4", 3), ("u1", 3), "<u4", "<u4"],
        "offsets": [0, 12, 16, 20],
        "itemsize": 24,
    }
)
FIELDS: Final = (
    PointField("x", 0, FLOAT32, 1),
    PointField("y", 4, FLOAT32, 1),
    PointField("z", 8, FLOAT32, 1),
    PointField("rgb", 12, FLOAT32, 1),
    PointField("label", 16, UINT32, 1),
    PointField("instance", 20, UINT32, 1),
)
"""rgb as PCL packs it: the bytes blue, green, red and 0, called a float32."""


def object_clouds(seen: ObjectClouds, number: int) -> bytes:
    """Translate ObjectClouds: points in the sensor's frame, each with its class and its object.

    label: the model's own number of the class. instance: the object's place in the frame's Detections.
    Points without colour are white.

    Raises:
        MessageError: what ROS's fields cannot hold.
    """
    points = np.zeros(sum(each.count for each in seen.objects), POINT)
    at = 0
    for each in seen.objects:
        _fill(points[at : at + each.count], each)
        at += each.count
    return encode_point_cloud(
        PointCloud(
            stamp=seen.header.stamp_ns,
            frame_id=seen.header.frame_id,
            height=1,
            width=len(points),
            fields=FIELDS,
            is_bigendian=False,
            point_step=POINT.itemsize,
            row_step=points.nbytes,
            data=points.view(np.uint8).data,
            is_dense=bool(np.isfinite(points["xyz"]).all()),
        ),
        seq=number,
    )


def _fill(points: NDArray[np.void], seen: ObjectCloud) -> None:
    points["xyz"] = np.frombuffer(seen.xyz, "<f4").reshape(-1, 3)
    points["bgr"] = np.frombuffer(seen.rgb, np.uint8).reshape(-1, 3)[:, ::-1] if seen.rgb.nbytes else WHITE
    points["label"], points["instance"] = seen.label, seen.index
