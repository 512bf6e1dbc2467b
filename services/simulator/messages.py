"""Builds ROS messages from simulated measurements. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from gateway.ros1.image import Image, encode_image
from gateway.ros1.messages import Time, new_message, serialise
from gateway.ros1.point_cloud import PointCloud, PointField, encode_point_cloud
from services.geometry.rotation import quaternion_of
from services.simulator.placement import Placement
from services.simulator.topics import CAMERA_INFO, TF_MESSAGE
from services.simulator.world import Camera, Turn, as_32fc1, organised_cloud

ENCODINGS: Final = {"uint8": "rgb8", "uint16": "16UC1", "float32": "32FC1"}
DATATYPES: Final = {"uint8": 2, "uint16": 4, "uint32": 6, "float32": 7}
"""The numbers of sensor_msgs/PointField."""


@dataclass(frozen=True, slots=True)
class Head:
    """A message's header. stamp: nanoseconds."""

    seq: int
    stamp: int
    frame_id: str = ""

    def of(self, frame_id: str) -> Self:
        """The same instant in another frame."""
        return replace(self, frame_id=frame_id)


def image_message(head: Head, pixels: NDArray[Any]) -> bytes:
    """Convert RGB (height, width, 3), or depth (height, width) in uint16 mm or float32 m, to a sensor_msgs/Image."""
    rows = np.ascontiguousarray(pixels)
    secs, nsecs = divmod(head.stamp, 1_000_000_000)
    return encode_image(
        Image(
            seq=head.seq,
            stamp_s=secs,
            stamp_ns=nsecs,
            frame_id=head.frame_id,
            height=rows.shape[0],
            width=rows.shape[1],
            encoding=ENCODINGS[rows.dtype.name],
            is_bigendian=False,
            step=rows.strides[0],
            data=rows.data.cast("B"),
        )
    )


def cloud_message(head: Head, points: NDArray[Any]) -> bytes:
    """Convert structured points (height, width), whose fields become the cloud's, to a sensor_msgs/PointCloud2."""
    rows = np.ascontiguousarray(points)
    cloud = PointCloud(
        stamp=head.stamp,
        frame_id=head.frame_id,
        height=rows.shape[0],
        width=rows.shape[1],
        fields=_fields(rows.dtype),
        is_bigendian=False,
        point_step=rows.itemsize,
        row_step=rows.shape[1] * rows.itemsize,
        data=rows.reshape(-1).view(np.uint8).data,
        is_dense=bool(np.isfinite(rows["x"]).all()),
    )
    return encode_point_cloud(cloud, seq=head.seq)


def _fields(points: np.dtype[Any]) -> tuple[PointField, ...]:
    described: Any = points.fields or {}
    return tuple(PointField(name, offset, DATATYPES[kind.name], 1) for name, (kind, offset) in described.items())


def info_message(head: Head, camera: Camera) -> bytes:
    """Convert a camera without distortion to a sensor_msgs/CameraInfo."""
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    whole = new_message("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    info = new_message(
        CAMERA_INFO,
        header=_header(head),
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        D=np.zeros(5),
        K=matrix.ravel(),
        R=np.eye(3).ravel(),
        P=np.hstack([matrix, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=whole,
    )
    return serialise(CAMERA_INFO, info)


def transforms_message(stamp: int, joints: Iterable[tuple[str, str, Placement]]) -> bytes:
    """Convert (parent, child, pose of the child in the parent) to a tf2_msgs/TFMessage."""
    return serialise(TF_MESSAGE, new_message(TF_MESSAGE, transforms=[_transform(stamp, *joint) for joint in joints]))


def _transform(stamp: int, parent: str, child: str, placement: Placement) -> Any:
    x, y, z = placement[:3, 3].tolist()
    qx, qy, qz, qw = quaternion_of(placement).tolist()
    moved = new_message(
        "geometry_msgs/Transform",
        translation=new_message("geometry_msgs/Vector3", x=x, y=y, z=z),
        rotation=new_message("geometry_msgs/Quaternion", x=qx, y=qy, z=qz, w=qw),
    )
    return new_message(
        "geometry_msgs/TransformStamped",
        header=_header(Head(0, stamp, parent)),
        child_frame_id=child,
        transform=moved,
    )


def _header(head: Head) -> Any:
    stamp = Time(*divmod(head.stamp, 1_000_000_000))
    return new_message("std_msgs/Header", seq=head.seq, stamp=stamp, frame_id=head.frame_id)


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
    """Return the packed colour seen at each pixel of depth, white outside the colour image.

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
    """Convert depth in whole millimetres, 0 for none, to metres, NaN for none."""
    return as_32fc1(depth.astype(np.float32) / np.float32(1000))
