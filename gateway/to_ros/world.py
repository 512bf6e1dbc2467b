"""ROS messages of the world around a robot: obstacles for its costmap, and markers for rviz. Pure."""

import colorsys
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.ros1.messages import Duration, Time, new_message, serialise
from gateway.ros1.point_cloud import PointCloud, PointField, encode_point_cloud
from gateway.to_ros.stream import StreamReturn, Translator, UnseenMessages
from schemas.keys import NEARBY, RobotStreamKey
from schemas.world import NearbyObjects, WorldObject

ROOT: Final = "fleetsight"
OBSTACLES_TOPIC: Final = f"{ROOT}/obstacles"
OBJECTS_TOPIC: Final = f"{ROOT}/objects"

Floats = NDArray[np.float64]

SPACING_M: Final = 0.05
"""Of an obstacle's points along its sides: a cell of a usual costmap."""

LEVELS: Final = (0.05, 0.5, 0.95)
"""Heights of an obstacle's points, in shares of its own: a costmap takes those between its two limits."""

MOST_POINTS: Final = 2_000
"""Of one obstacle; the sides of a larger one have points farther apart."""

FLOAT32: Final = 7
POINT_BYTES: Final = 12
FIELDS: Final = tuple(PointField(name, 4 * number, FLOAT32, 1) for number, name in enumerate("xyz"))

OWN_NS: Final = 2_000_000_000
"""Objects that the robot itself saw this recently are in its own sensors' part of the costmap already."""

NS: Final = 1_000_000_000


def outline(each: WorldObject) -> Floats:
    """Return points (n, 3) on the upright sides of an object's box, in the map, metres."""
    length, width, height = each.size
    around = 2 * (length + width)
    spacing = max(SPACING_M, around * len(LEVELS) / MOST_POINTS)
    across, along = (max(1, int(np.ceil(side / spacing))) for side in (width, length))
    x, y = np.linspace(-0.5, 0.5, along + 1) * length, np.linspace(-0.5, 0.5, across + 1) * width
    sides = [(x, np.full(len(x), side * width / 2)) for side in (-1, 1)]
    sides += [(np.full(len(y), side * length / 2), y) for side in (-1, 1)]
    level = np.concatenate([np.stack(side, axis=1) for side in sides])
    cos, sin = np.cos(each.yaw or 0.0), np.sin(each.yaw or 0.0)
    turned = level @ np.array([[cos, sin], [-sin, cos]]) + each.at[:2]
    heights = each.at[2] + (np.array(LEVELS) - 0.5) * height
    return np.concatenate([np.column_stack([turned, np.full(len(turned), z)]) for z in heights])


def obstacles(seen: NearbyObjects, number: int, stamp_ns: int, *, own: bool = True) -> bytes:
    """Translate NearbyObjects: a PointCloud2 of the sides of all boxes, for a costmap's obstacle layer.

    stamp_ns: ROS time now; the world model's clock may be another. own: with what the robot itself sees now.

    Raises:
        MessageError: what ROS's fields cannot hold.
    """
    boxes = [outline(each) for each in seen.objects if own or not is_own(each, seen)]
    points = np.concatenate([np.zeros((0, 3)), *boxes]).astype("<f4")
    return encode_point_cloud(
        PointCloud(
            stamp=stamp_ns,
            frame_id=seen.frame_id,
            height=1,
            width=len(points),
            fields=FIELDS,
            is_bigendian=False,
            point_step=POINT_BYTES,
            row_step=points.nbytes,
            data=np.ascontiguousarray(points).view(np.uint8).reshape(-1).data,
            is_dense=True,
        ),
        seq=number,
    )


def is_own(each: WorldObject, seen: NearbyObjects) -> bool:
    """Return whether the robot itself saw an object just now."""
    return any(seer.robot == seen.robot and seen.sent_ns - seer.last_ns <= OWN_NS for seer in each.seen_by)


MARKERS: Final = "visualization_msgs/MarkerArray"
CUBE, TEXT = 1, 9
LIFETIME_S: Final = 3
"""Of a marker: rviz removes what is no longer sent."""

TEXT_M: Final = 0.15
FADED_S: Final = 600.0
"""Age at which a marker is faintest."""

FAINTEST: Final = 0.25


def markers(seen: NearbyObjects, number: int, stamp_ns: int) -> bytes:
    """Translate NearbyObjects: a MarkerArray of a box and a name for each object, faded by age.

    stamp_ns: ROS time now. Namespace and id of an object's markers are the same as long as its id is.

    Raises:
        MessageError: what ROS's fields cannot hold.
    """
    made = [marker for each in seen.objects for marker in _markers(each, seen, _Stamp(number, stamp_ns))]
    return serialise(MARKERS, new_message(MARKERS, markers=made))


@dataclass(frozen=True, slots=True)
class _Shape:
    """The shape of a marker. scale: metres. at: its centre in the map. rgba: 0 to 1."""

    namespace: str
    kind: int
    scale: tuple[float, float, float]
    at: tuple[float, float, float]
    rgba: tuple[float, float, float, float]
    text: str = ""


@dataclass(frozen=True, slots=True)
class _Stamp:
    """The number of a message, and ROS time when it is sent."""

    number: int
    at_ns: int


def _markers(each: WorldObject, seen: NearbyObjects, stamp: _Stamp) -> list[Any]:
    age_s = max(0.0, (seen.sent_ns - each.last_ns) / NS)
    alpha = max(FAINTEST, 1 - (1 - FAINTEST) * age_s / FADED_S)
    length, width, height = (max(side, SPACING_M) for side in each.size)
    x, y, z = each.at
    shapes = (
        _Shape(each.name, CUBE, (length, width, height), each.at, (*colour(each.name), 0.6 * alpha)),
        _Shape(
            f"{each.name} names",
            TEXT,
            (0.0, 0.0, TEXT_M),
            (x, y, z + height / 2 + TEXT_M),
            (1.0, 1.0, 1.0, alpha),
            f"{each.name} {each.id}",
        ),
    )
    return [_marker(shape, each, seen.frame_id, stamp) for shape in shapes]


def _marker(shape: _Shape, each: WorldObject, frame_id: str, stamp: _Stamp) -> Any:
    half = (each.yaw or 0.0) / 2
    return new_message(
        "visualization_msgs/Marker",
        header=new_message(
            "std_msgs/Header", seq=stamp.number, stamp=Time(*divmod(stamp.at_ns, NS)), frame_id=frame_id
        ),
        ns=shape.namespace,
        id=marker_id(each.id),
        type=shape.kind,
        action=0,
        pose=new_message(
            "geometry_msgs/Pose",
            position=_of("geometry_msgs/Point", "xyz", shape.at),
            orientation=_of("geometry_msgs/Quaternion", "xyzw", (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))),
        ),
        scale=_of("geometry_msgs/Vector3", "xyz", shape.scale),
        color=_of("std_msgs/ColorRGBA", "rgba", shape.rgba),
        lifetime=Duration(LIFETIME_S, 0),
        frame_locked=False,
        points=[],
        colors=[],
        text=shape.text,
        mesh_resource="",
        mesh_use_embedded_materials=False,
    )


def _of(type_name: str, fields: str, values: Iterable[float]) -> Any:
    return new_message(type_name, **dict(zip(fields, values, strict=True)))


def marker_id(world_id: str) -> int:
    """Return the number that stands for an object's id in its class's namespace: 31 bits of a checksum."""
    return zlib.crc32(world_id.encode()) & 0x7FFFFFFF


def colour(name: str) -> tuple[float, float, float]:
    """Return a class's colour, red, green and blue from 0 to 1, the same everywhere."""
    return colorsys.hls_to_rgb(zlib.crc32(name.encode()) / 2**32, 0.5, 0.8)


def world_returns(
    robot: str, resolve: Callable[[str], str], *, own: bool, ros_time_ns: Callable[[], int]
) -> list[StreamReturn[NearbyObjects]]:
    """Return the two streams of what is near a robot. own: obstacles with what the robot itself sees now.

    resolve: a name to a global ROS name for the gateway's node. ros_time_ns: tells the time, which may be simulated.
    """
    key = RobotStreamKey(robot, NEARBY)

    def cloud(seen: NearbyObjects, number: int) -> bytes:
        return obstacles(seen, number, ros_time_ns(), own=own)

    def boxes(seen: NearbyObjects, number: int) -> bytes:
        return markers(seen, number, ros_time_ns())

    made = (
        (OBSTACLES_TOPIC, Translator(NearbyObjects, ros_point_cloud.TYPE_NAME, cloud, heavy=True)),
        (OBJECTS_TOPIC, Translator(NearbyObjects, MARKERS, boxes, heavy=True)),
    )
    return [
        StreamReturn(
            key, translator, UnseenMessages[NearbyObjects](key, lambda seen: seen.sent_ns), {"": resolve(topic)}
        )
        for topic, translator in made
    ]
