"""What the robot's sensors measure, rendered before anything is measured, and its messages with the stamps of now."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.guide.outputs import stamped
from benchmarks.guide.topics import COLOR, DEPTH, POINTS
from gateway.ros1 import image, point_cloud
from services.simulator.film import Equipment, Film, Store
from services.simulator.robot import Robot
from services.simulator.topics import CAMERA_INFO, TF_TOPICS, Content, Topic
from services.simulator.world import Camera

SEED: Final = 3_000_000
WIDTH: Final = 640
HEIGHT: Final = 480
FIELD_RAD: Final = 1.2

SENSORS: Final = (
    Topic("camera/color/camera_info", Content.COLOR_INFO, CAMERA_INFO),
    Topic("camera/depth/camera_info", Content.DEPTH_INFO, CAMERA_INFO),
    Topic(COLOR[1:], Content.COLOR, image.TYPE_NAME),
    Topic(DEPTH[1:], Content.DEPTH, image.TYPE_NAME),
    Topic(POINTS[1:], Content.POINTS, point_cloud.TYPE_NAME),
)
"""Each message begins with a header."""
STATIC, MOVING = TF_TOPICS


class Scene:
    """Instants all over a drive through a warehouse, in a loop: depth registered to colour, 16UC1, and its points.

    The robot stands at each: they are too far apart to drive from one to the next.
    """

    def __init__(self, instants: int) -> None:
        camera = Camera.with_field_of_view(WIDTH, HEIGHT, FIELD_RAD)
        film = Film(SEED, Equipment(camera), instants, 0.0, Store(1 << 30))
        self._robot = Robot("r1", "", film, (*TF_TOPICS, *SENSORS))
        self._instants = [self._robot.publish(number, SENSORS, lambda: 0) for number in range(instants)]

    def messages(self, number: int, stamp_ns: int) -> Iterator[tuple[Topic, bytes]]:
        """Return an instant's messages, transforms first, each made when it is asked for."""
        yield from self._robot.publish(number, [MOVING], lambda: stamp_ns)
        for topic, message in self._instants[number % len(self._instants)]:
            yield topic, stamped(message, stamp_ns)

    @property
    def pictures(self) -> NDArray[np.uint8]:
        """What the colour camera sees, instants x HEIGHT x WIDTH x 3."""
        sent = [message for instant in self._instants for topic, message in instant if topic.content is Content.COLOR]
        decoded = [np.frombuffer(image.decode_image(message).data, np.uint8) for message in sent]
        return np.stack([pixels.reshape(HEIGHT, WIDTH, 3) for pixels in decoded])

    def static(self, stamp_ns: int) -> bytes:
        """Return where the sensors are on the robot."""
        ((_, message),) = self._robot.publish(0, [STATIC], lambda: stamp_ns)
        return message

    def size(self, content: Content) -> int:
        """Return how many bytes a message of a sensor has."""
        return next(len(message) for topic, message in self._instants[0] if topic.content is content)
