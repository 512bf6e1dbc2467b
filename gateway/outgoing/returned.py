"""What a gateway returns to ROS, and where it goes."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from gateway.outgoing.clouds import object_clouds
from gateway.outgoing.images import image
from gateway.outgoing.novelty import NewerFrames, UnseenMessages
from gateway.outgoing.stream import StreamReturn
from gateway.outgoing.texts import STRING, action, alert, classes, distances
from gateway.outgoing.topics import ALERTS_TOPIC, RESULTS
from gateway.outgoing.translator import Translator
from gateway.ros1 import image as ros_image
from gateway.ros1 import point_cloud as ros_point_cloud
from schemas.alerts import Action, Alert
from schemas.detections import ClassList
from schemas.distances import Distances
from schemas.image import ImageFrame
from schemas.keys import ACTIONS, ALERTS, CameraKey, RobotStreamKey, Stream, StreamKey
from schemas.objects import ObjectClouds

MESSAGES_WAITING: Final = 64

CLASSES: Final = Translator(ClassList, STRING, classes)
DISTANCES: Final = Translator(Distances, STRING, distances)
OVERLAY: Final = Translator(ImageFrame, ros_image.TYPE_NAME, image, heavy=True)
OBJECTS: Final = Translator(ObjectClouds, ros_point_cloud.TYPE_NAME, object_clouds, heavy=True)
ALERT: Final = Translator(Alert, STRING, alert, waiting=MESSAGES_WAITING, latched=True)
ACTION: Final = Translator(
    Action, STRING, action, waiting=MESSAGES_WAITING, unasked=True, route=lambda asked: asked.name
)
"""Unasked, so that a refused action is said to be refused."""

CAMERA_RETURNS: Final[Mapping[Stream, Translator[Any]]] = {
    Stream.CLASSES: CLASSES,
    Stream.DISTANCES: DISTANCES,
    Stream.OVERLAY_DETECTION: OVERLAY,
    Stream.OVERLAY_SEGMENTATION: OVERLAY,
    Stream.OBJECTS: OBJECTS,
}

Resolve = Callable[[str], str]
"""Returns the global ROS name that a name means to the gateway's node."""


def camera_returns(camera: CameraKey, root: str, resolve: Resolve) -> list[StreamReturn[Any]]:
    """Return every stream that a gateway returns for a camera; `root` is the camera's result namespace on ROS."""
    return [
        StreamReturn(
            StreamKey(camera, stream), translator, NewerFrames(camera), {"": resolve(f"{root}/{RESULTS[stream]}")}
        )
        for stream, translator in CAMERA_RETURNS.items()
    ]


def alerts_return(robot: str, resolve: Resolve) -> StreamReturn[Alert]:
    """Return the stream of a robot's alerts; one comes again whenever it changes."""
    key = RobotStreamKey(robot, ALERTS)
    novelty = UnseenMessages[Alert](key, lambda said: (said.id, said.changed_ns))
    return StreamReturn(key, ALERT, novelty, {"": resolve(ALERTS_TOPIC)})


def actions_return(robot: str, allowed: Mapping[str, str], resolve: Resolve) -> StreamReturn[Action]:
    """Return the stream of a robot's actions; `allowed` has the topic of each that it takes."""
    key = RobotStreamKey(robot, ACTIONS)
    topics = {action: resolve(topic) for action, topic in allowed.items()}
    return StreamReturn(key, ACTION, UnseenMessages[Action](key, lambda asked: asked.id), topics)
