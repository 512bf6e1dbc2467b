"""Listening to the fleet: results, images and presence."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final, TypeVar

from bus import LATEST, Bus, Latest, Queue, Subscription
from bus.clocks import clock_id
from fleetsight.arguments import QUEUE, check_keep
from fleetsight.patterns import chunk, one_camera
from fleetsight.presence import Roster, WorkerName
from fleetsight.streams import Iterations, Stream
from schemas import codec, keys, worker_keys
from schemas.alerts import Alert
from schemas.consumer_keys import Wanted, new_consumer
from schemas.detections import ClassList, Detections
from schemas.distances import Distances
from schemas.image import ImageFrame
from schemas.keys import CameraKey, RobotStreamKey
from schemas.objects import ObjectClouds

ALERTS_KEPT: Final = QUEUE(1_000, 64 << 20)
"""None replaces another; of more than these the oldest go."""

T = TypeVar("T")
R = TypeVar("R", ClassList, Detections, Distances, ObjectClouds)


class Listening:
    """The part of `fleetsight.Fleet` that listens."""

    def __init__(self, bus: Bus, iterations: Iterations, certificate: Path | None = None) -> None:
        self._bus = bus
        self._iterations = iterations
        self._certificate = certificate

    def class_lists(self, robot: str = "*", camera: str = "*", *, keep: Latest | Queue = LATEST) -> Stream[ClassList]:
        """Return which classes are in view of cameras, frame by frame; first what was last known of each.

        Subscribing makes detectors look at these cameras.

        Raises:
            SettingsError: a name, a pattern or `keep` that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         async for seen in fleet.class_lists(robot="r*"):
        ...             return seen.header.robot, seen.header.camera, seen.classes[0].name
        >>> asyncio.run(main())
        ('r1', 'front', 'box')
        """
        return self._results(ClassList, keys.Stream.CLASSES, robot, camera, keep)

    def detections(self, robot: str = "*", camera: str = "*", *, keep: Latest | Queue = LATEST) -> Stream[Detections]:
        """Return the objects in the images of cameras, best score first: boxes in pixels, masks, tracks.

        Subscribing makes detectors look at these cameras, and make masks.

        Raises:
            SettingsError: a name, a pattern or `keep` that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         async for found in fleet.detections("r1", "front"):
        ...             return found.width, found.height, found.objects[0].box
        >>> asyncio.run(main())
        (6, 4, Box(x1=1.0, y1=1.0, x2=3.0, y2=4.0))
        """
        return self._results(Detections, keys.Stream.DETECTIONS, robot, camera, keep)

    def distances(self, robot: str = "*", camera: str = "*", *, keep: Latest | Queue = LATEST) -> Stream[Distances]:
        """Return how far away the objects are, in metres, and where; each is `measured`, or `unknown` for a reason.

        Subscribing makes distance workers measure these cameras, and detectors look at them.

        Raises:
            SettingsError: a name, a pattern or `keep` that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         async for far in fleet.distances(robot="r1"):
        ...             return [each.measured.axial_m for each in far.objects if each.measured]
        >>> asyncio.run(main())
        [2.5]
        """
        return self._results(Distances, keys.Stream.DISTANCES, robot, camera, keep)

    def objects(self, robot: str = "*", camera: str = "*", *, keep: Latest | Queue = LATEST) -> Stream[ObjectClouds]:
        """Return the points of the objects, in metres, and the upright box around each. Nothing is kept of the past.

        Subscribing makes cloud workers cut them out, and detectors look at these cameras.

        Raises:
            SettingsError: a name, a pattern or `keep` that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         async for clouds in fleet.objects(robot="r1"):
        ...             return [(each.name, each.count) for each in clouds.objects]
        >>> asyncio.run(main())
        [('box', 2)]
        """
        return self._results(ObjectClouds, keys.Stream.OBJECTS, robot, camera, keep)

    def alerts(self, robot: str = "*", *, keep: Latest | Queue = ALERTS_KEPT) -> Stream[Alert]:
        """Return the alerts of robots as they are raised and change; first the last one of each robot.

        Raises:
            SettingsError: a name, a pattern or `keep` that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         async for alert in fleet.alerts(robot="r1"):
        ...             return str(alert.severity), str(alert.state), alert.text
        >>> asyncio.run(main())
        ('warning', 'raised', 'a box stands in the way')
        """
        key = f"fleet/{chunk('robot', robot)}/{keys.ALERTS}"

        def check(key: str, alert: Alert) -> None:
            codec.check_robot(alert.robot, RobotStreamKey(keys.parse_robot(key), keys.ALERTS))

        check_keep(keep)
        return Stream(self._iterations, "alerts", Alert, lambda: self._bus.subscribe(key, keep), check)

    def images(self, robot: str, camera: str, *, keep: Latest | Queue = LATEST) -> Stream[ImageFrame]:
        """Return the colour images of one camera, named in full, as its gateway sends them: see `ImageFrame.format`.

        Subscribing has them sent, all the way from the camera: take them only while they are needed.

        Raises:
            SettingsError: a name or `keep` that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         async for image in fleet.images("r1", "front"):
        ...             return image.width, image.height, image.encoding, image.format
        >>> asyncio.run(main())
        (6, 4, 'rgb8', 'raw')
        """
        of = one_camera(robot, camera)
        check_keep(keep)

        def check(_: str, frame: ImageFrame) -> None:
            codec.check_identity(frame.header, of)

        return Stream(self._iterations, f"images of {of}", ImageFrame, lambda: images_of(self._bus, of, keep), check)

    def robots(self) -> Roster[str]:
        """Return which robots are there, by name.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         return await fleet.robots().present()
        >>> asyncio.run(main())
        frozenset({'r1'})
        """
        return self._roster("robots", keys.EVERY_ROBOT_ALIVE, keys.parse_robot)

    def cameras(self, robot: str = "*", camera: str = "*") -> Roster[CameraKey]:
        """Return which cameras with colour images are there; each has a `robot` and a `camera`.

        Raises:
            SettingsError: a name or a pattern that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         async for change in fleet.cameras():
        ...             return change.who.robot, change.who.camera, change.here
        >>> asyncio.run(main())
        ('r1', 'front', True)
        """
        key = f"fleet/{chunk('robot', robot)}/{chunk('camera', camera)}/{keys.Stream.COLOR}/{keys.ALIVE}"
        return self._roster("cameras", key, lambda token: keys.parse_stream(token).camera)

    def workers(self, service: str = "*") -> Roster[WorkerName]:
        """Return which workers are there. service: what they do, such as `detector`, `distance` or `cloud`.

        Raises:
            SettingsError: a name or a pattern that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         return await fleet.workers("detector").present()
        >>> asyncio.run(main())
        frozenset({WorkerName(service='detector', worker='w1')})
        """
        key = f"workers/{chunk('service', service)}/*/*/*/{keys.ALIVE}"

        def named(token: str) -> WorkerName:
            return WorkerName(*worker_keys.parse_worker(token))

        return self._roster("workers", key, named)

    def _roster(self, what: str, key: str, parse: Callable[[str], T]) -> Roster[T]:
        return Roster(self._iterations, what, lambda: self._bus.watch(key), parse, lambda: self._bus.link_problem)

    def _results(
        self, schema: type[R], stream: keys.Stream, robot: str, camera: str, keep: Latest | Queue
    ) -> Stream[R]:
        key = f"fleet/{chunk('robot', robot)}/{chunk('camera', camera)}/{stream}"
        history = stream is not keys.Stream.OBJECTS
        check_keep(keep)

        def check(key: str, message: R) -> None:
            codec.check_identity(message.header, keys.parse_stream(key).camera)

        return Stream(
            self._iterations, str(stream), schema, lambda: self._bus.subscribe(key, keep, history=history), check
        )


@asynccontextmanager
async def images_of(bus: Bus, camera: CameraKey, keep: Latest | Queue) -> AsyncIterator[Subscription]:
    """Subscribe to the images. The gateway sends them raw to a program beside it, and as JPEG to others."""
    color = keys.StreamKey(camera, keys.Stream.COLOR)
    token = Wanted(color, clock_id(), new_consumer(bus.certificate))
    async with bus.announce(str(token)), bus.subscribe(str(color), keep, history=False) as frames:
        yield frames
