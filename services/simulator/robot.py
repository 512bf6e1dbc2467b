"""A simulated robot: the messages of its sensors' drivers at an instant. Pure."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final, assert_never

import numpy as np

from services.simulator.film import Array, Film, Part
from services.simulator.localisation import Localisation, disturbed
from services.simulator.messages import (
    Head,
    cloud_message,
    colored_points,
    image_message,
    info_message,
    metres,
    packed,
    projected,
    transforms_message,
)
from services.simulator.placement import BASE, COLOR_OPTICAL, DEPTH_OPTICAL, LIDAR, MAP, ODOM, Placement, odometry_error
from services.simulator.topics import Content, Topic

NEEDED: Final[Mapping[Content, frozenset[Part]]] = {
    Content.COLOR: frozenset({Part.COLOR}),
    Content.DEPTH: frozenset({Part.DEPTH}),
    Content.POINTS: frozenset({Part.COLOR, Part.DEPTH}),
    Content.LIDAR: frozenset({Part.SWEEP}),
}
"""The measurements that a message needs; other messages need none."""

Way = list[tuple[str, str, Placement]]
"""Frames between the map and the robot: parent, child, pose of the child in the parent."""


class Robot:
    """Drives along a film, `ahead` instants ahead of its beginning.

    namespace: `` or like `/r1`; its topics are below it. localisation: its errors; None where it has none.
    """

    def __init__(
        self,
        name: str,
        namespace: str,
        film: Film,
        topics: Sequence[Topic],
        ahead: int = 0,
        *,
        localisation: Localisation | None = None,
    ) -> None:
        self.name = name
        self.topics = topics
        self._namespace = namespace
        self.film = film
        self.ahead = ahead
        self.localisation = localisation

    def path(self, topic: Topic) -> str:
        """Return the topic's global name."""
        return f"{self._namespace}/{topic.name}"

    @property
    def parts(self) -> frozenset[Part]:
        """The measurements that its topics need."""
        return _parts(self.topics)

    def publish(
        self, number: int, wanted: Collection[Topic], clock: Callable[[], int], second: float = 0.0
    ) -> list[tuple[Topic, bytes]]:
        """Return the messages of the wanted topics at an instant, transforms first, all with the stamp from `clock`.

        The clock is read once all is measured: simulating takes time that measuring does not. second: when that is,
        since the start, which says how far localisation is off and how the world has changed.
        """
        instant = number + self.ahead
        measured = self.film.measure(instant, _parts(wanted), second)
        stamp = clock()
        return [
            (topic, self._message(topic.content, Head(number, stamp), self._way(instant, second), measured))
            for topic in self.topics
            if topic in wanted
        ]

    def _message(self, content: Content, head: Head, way: Way, measured: Mapping[Part, Array]) -> bytes:
        sensors = self.film.equipment
        match content:
            case Content.COLOR_INFO:
                message = info_message(head.of(COLOR_OPTICAL), sensors.color)
            case Content.DEPTH_INFO:
                message = info_message(head.of(sensors.depth_frame), sensors.depth_camera)
            case Content.COLOR:
                message = image_message(head.of(COLOR_OPTICAL), measured[Part.COLOR])
            case Content.DEPTH:
                depth = measured[Part.DEPTH]
                message = image_message(head.of(sensors.depth_frame), metres(depth) if sensors.metric else depth)
            case Content.POINTS:
                message = cloud_message(head.of(sensors.depth_frame), self._points(measured))
            case Content.LIDAR:
                message = cloud_message(head.of(LIDAR), measured[Part.SWEEP])
            case Content.TF:
                message = transforms_message(head.stamp, way)
            case Content.TF_STATIC:
                message = transforms_message(head.stamp, self.film.rig.static())
            case _:
                assert_never(content)
        return message

    def _points(self, measured: Mapping[Part, Array]) -> Array:
        sensors = self.film.equipment
        depth, rgb = metres(measured[Part.DEPTH]), packed(measured[Part.COLOR])
        if not sensors.aligned:
            rgb = projected(rgb, sensors.color, depth, sensors.depth_camera, self._color_of_depth())
        return colored_points(depth, sensors.depth_camera, rgb)

    def _color_of_depth(self) -> Placement:
        """The pose of depth's optical frame in that of colour."""
        rig = self.film.rig
        return np.linalg.inv(rig.on_robot(COLOR_OPTICAL)) @ rig.on_robot(DEPTH_OPTICAL)

    def _way(self, instant: int, second: float) -> Way:
        odom, robot = odometry_error(self.film.fraction(instant)), self.film.robot(instant)
        in_odom = np.linalg.inv(odom) @ robot
        if self.localisation is not None:
            odom = disturbed(robot, self.localisation.error(second)) @ np.linalg.inv(in_odom)
        return [(MAP, ODOM, odom), (ODOM, BASE, in_odom)]


def _parts(topics: Collection[Topic]) -> frozenset[Part]:
    return frozenset[Part]().union(*(NEEDED.get(topic.content, ()) for topic in topics))
