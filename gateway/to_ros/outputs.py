"""ROS topics and messages of results: class lists, distances, overlays, object clouds and alerts.

Pure.
"""

import re
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import msgspec
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from gateway.node_names import ros_chunk
from gateway.ros1 import image as ros_image
from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.ros1.image import Image, encode_image
from gateway.ros1.messages import new_message, serialise
from gateway.ros1.point_cloud import PointCloud, PointField, encode_point_cloud
from gateway.to_ros import world
from gateway.to_ros.actions import FreshActions
from gateway.to_ros.done_actions import DoneActions
from gateway.to_ros.stream import NewerFrames, StreamReturn, Translator, UnseenMessages
from schemas.alerts import Action, Alert
from schemas.compression import JPEG, RAW
from schemas.detections import MAX_DETECTIONS, ClassList
from schemas.distances import Distances
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import ACTIONS, ALERTS, CameraKey, RobotStreamKey, Stream, StreamKey
from schemas.objects import ObjectCloud, ObjectClouds

ROOT: Final = "ultralytics"
ROOTS: Final = frozenset({ROOT, world.ROOT})
ALERTS_TOPIC: Final = f"{ROOT}/alerts"
RESULTS: Final[Mapping[Stream, str]] = {
    Stream.CLASSES: "detection/classes",
    Stream.DISTANCES: "detection/distance",
    Stream.OVERLAY_DETECTION: "detection/image",
    Stream.OVERLAY_SEGMENTATION: "segmentation/image",
    Stream.OBJECTS: "segmentation/points",
}
"""Topics below the namespace of a camera's results, by stream."""


def result_root(camera: str, *, first: bool) -> str:
    """Return the ROS namespace of a camera's results, relative to the gateway's; the first camera has no chunk."""
    return ROOT if first else f"{ROOT}/{ros_chunk(camera)}"


def is_result(topic: str) -> bool:
    """Return whether a topic is where gateways publish results, in any namespace, so it is no sensor's."""
    return not ROOTS.isdisjoint(topic.split("/"))


def results_of(gateway: str, publishers: Mapping[str, Collection[str]]) -> list[str]:
    """Return the result topics of a gateway's node, given all publishing nodes by topic."""
    return [topic for topic, nodes in publishers.items() if gateway in nodes and is_result(topic)]


def recorders(topics: Collection[str], subscribers: Mapping[str, Collection[str]]) -> list[str]:
    """Return the nodes that subscribe to all given topics, as `rosbag record -a` does."""
    found = [set(subscribers.get(topic, ())) for topic in topics]
    return sorted(set.intersection(*found)) if len(found) > 1 else []


def cure(recorder: str) -> str:
    """Return the advice that keeps a recorder from requesting results."""
    pattern = re.sub(r"_\d+$", "_.*", recorder)  # rosbag's number differs each time
    return (
        f"`rosbag record -a -x '.*/({ROOT}|{world.ROOT})/.*'` leaves results out; a gateway with "
        f"--passive-subscribers '{pattern}' gives it those that others want"
    )


STRING: Final = "std_msgs/String"


def string(text: str) -> bytes:
    """Return a serialised std_msgs/String."""
    return serialise(STRING, new_message(STRING, data=text))


def classes(seen: ClassList, _: int) -> bytes:
    """Translate a ClassList: a Python list of names, one entry per object.

    Raises:
        SchemaError: more objects than one image can have, so that a short message cannot become a long one.
    """
    total = sum(each.count for each in seen.classes)
    if total > MAX_DETECTIONS:
        raise SchemaError(f"{total} objects in one image, at most {MAX_DETECTIONS} are returned")
    return string(repr([each.name for each in seen.classes for _ in range(each.count)]))


def distances(seen: Distances, _: int) -> bytes:
    """Translate Distances: a Python list of `name: 2.31m` along the optical axis; unknown ones are left out."""
    known = ((each.name, each.measured) for each in seen.objects)
    return string(repr([f"{name}: {measured.axial_m:.2f}m" for name, measured in known if measured is not None]))


def alert(said: Alert, _: int) -> bytes:
    """Translate an Alert: a JSON object of its fields."""
    return string(msgspec.json.encode(said).decode())


def action(asked: Action, _: int) -> bytes:
    """Translate an Action: its payload."""
    return string(asked.payload)


COLOR_SPACES: Final = {"rgb8": "RGB", "mono8": "GRAY"}
"""Encoding of decoded JPEG files."""


def image(frame: ImageFrame, number: int) -> bytes:
    """Translate a raw or JPEG image; its stamp and frame are the source's, its seq the message's own.

    Raises:
        SchemaError: a file that is damaged or of another format.
        MessageError: what ROS's fields cannot hold.
    """
    data, step = (frame.data, frame.step) if frame.format == RAW else _decoded(frame)
    stamp_s, stamp_ns = divmod(frame.header.stamp_ns, 1_000_000_000)
    return encode_image(
        Image(
            seq=number,
            stamp_s=stamp_s,
            stamp_ns=stamp_ns,
            frame_id=frame.header.frame_id,
            height=frame.height,
            width=frame.width,
            encoding=frame.encoding,
            is_bigendian=frame.is_bigendian,
            step=step,
            data=data,
        )
    )


def _decoded(frame: ImageFrame) -> tuple[memoryview, int]:
    """Return pixels and the bytes of a row; the size in the file is checked before memory is allocated."""
    if frame.format != JPEG or frame.encoding not in COLOR_SPACES:
        raise SchemaError(f"an overlay as {frame.format} of {frame.encoding} pixels: only raw and JPEG are returned")
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(frame.data)
        if (height, width) != (frame.height, frame.width):
            raise SchemaError(f"{frame.width}x{frame.height} pixels, the decoder finds {width}x{height}")
        pixels = simplejpeg.decode_jpeg(frame.data, COLOR_SPACES[frame.encoding])
    except (ValueError, KeyError) as error:  # KeyError: a subsampling unknown to simplejpeg
        raise SchemaError(f"a JPEG file that cannot be decoded: {error!r}") from error
    return pixels.data.cast("B"), pixels.strides[0]


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
"""PCL's packed rgb: the bytes blue, green, red and 0, declared as float32."""


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


MESSAGES_WAITING: Final = 64

CLASSES: Final = Translator(ClassList, STRING, classes)
DISTANCES: Final = Translator(Distances, STRING, distances)
OVERLAY: Final = Translator(ImageFrame, ros_image.TYPE_NAME, image, heavy=True)
OBJECTS: Final = Translator(ObjectClouds, ros_point_cloud.TYPE_NAME, object_clouds, heavy=True)
ALERT: Final = Translator(Alert, STRING, alert, waiting=MESSAGES_WAITING, latched=True)
ACTION: Final = Translator(Action, STRING, action, waiting=MESSAGES_WAITING, eager=True, route=lambda asked: asked.name)
"""Actions of a robot, received without demand, so that a refused action is logged."""

CAMERA_RETURNS: Final[Mapping[Stream, Translator[Any]]] = {
    Stream.CLASSES: CLASSES,
    Stream.DISTANCES: DISTANCES,
    Stream.OVERLAY_DETECTION: OVERLAY,
    Stream.OVERLAY_SEGMENTATION: OVERLAY,
    Stream.OBJECTS: OBJECTS,
}

Resolve = Callable[[str], str]
"""Resolves a name to a global ROS name for the gateway's node."""


def camera_returns(camera: CameraKey, root: str, resolve: Resolve) -> list[StreamReturn[Any]]:
    """Return all result streams of a camera. root: the ROS namespace of its results."""
    return [
        StreamReturn(
            StreamKey(camera, stream), translator, NewerFrames(camera), {"": resolve(f"{root}/{RESULTS[stream]}")}
        )
        for stream, translator in CAMERA_RETURNS.items()
    ]


def alerts_return(robot: str, resolve: Resolve) -> StreamReturn[Alert]:
    """Return the stream of a robot's alerts; an alert is sent again when it changes."""
    key = RobotStreamKey(robot, ALERTS)
    novelty = UnseenMessages[Alert](key, lambda said: (said.id, said.changed_ns))
    return StreamReturn(key, ALERT, novelty, {"": resolve(ALERTS_TOPIC)})


def actions_return(
    robot: str, allowed: Mapping[str, str], resolve: Resolve, before: DoneActions | None = None
) -> StreamReturn[Action]:
    """Return the stream of a robot's actions. allowed: the topic of each allowed action. before: those done already."""
    key = RobotStreamKey(robot, ACTIONS)
    topics = {action: resolve(topic) for action, topic in allowed.items()}
    return StreamReturn(key, ACTION, FreshActions(key, before), topics)
