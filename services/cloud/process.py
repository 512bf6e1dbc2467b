"""The cloud process: joins the bus and works."""

import asyncio
import logging
from collections import defaultdict
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from typing import Any, Final

from bus import Bus, Publisher, QoS, open_bus
from bus.sharing.sharing import JOIN_S
from bus.sharing.work_counts import Tallies, Tally
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.keys import CameraKey, Stream, StreamKey
from schemas.objects import ObjectClouds
from services.cloud.camera import CloudCamera
from services.cloud.settings import CloudSettings
from services.geometry.memory_budget import MIB, MemoryBudget
from services.worker.thread import TimedExecutor, worker_thread
from services.worker.worker import ResultStream, Worker, publish_while_wanted


class Sensors:
    """Tracks the cameras and point streams online. chosen: point source per camera name, from the settings."""

    def __init__(self, chosen: Mapping[str, str]) -> None:
        self._chosen = chosen
        self._there: defaultdict[tuple[str, Stream], set[CameraKey]] = defaultdict(set)

    def note(self, key: StreamKey, *, alive: bool) -> None:
        """Note that a stream of points or colour appeared or disappeared."""
        of = (key.camera.robot, key.stream)
        (self._there[of].add if alive else self._there[of].discard)(key.camera)
        if not self._there[of]:
            del self._there[of]

    def points_of(self, camera: CameraKey) -> CameraKey | None:
        """Return the sensor whose points a camera uses, if it is online.

        Its own; else those of the first, by name, of the robot's sensors that see no colour: a lidar.
        """
        there, colors = (self._there.get((camera.robot, stream), set()) for stream in (Stream.POINTS, Stream.COLOR))
        if camera.camera in self._chosen:
            chosen = CameraKey(camera.robot, self._chosen[camera.camera])
            return chosen if chosen in there else None
        if camera in there:
            return camera
        return min(there - colors, default=None)


log = logging.getLogger(__name__)

SERVICE: Final = "cloud"
METHOD: Final = "geometry"
"""The model's name in status messages."""


class CloudWorker:
    """Serves the cameras assigned to this worker. executor: cuts clouds, off the event loop."""

    def __init__(self, bus: Bus, settings: CloudSettings, executor: Executor, *, join_s: float = JOIN_S) -> None:
        self._bus = bus
        self._settings = settings
        self._executor = TimedExecutor(executor)
        self._sensors = Sensors(settings.points)
        self._changed: defaultdict[str, asyncio.Event] = defaultdict(asyncio.Event)
        self._budget = MemoryBudget(settings.memory_mib * MIB)
        tokens = settings.tokens(SERVICE)
        self._worker = Worker(
            bus,
            tokens,
            Tallies(Tally),
            self._serve,
            details=self._details,
            pending=self._executor.pending,
            join_s=join_s,
        )

    async def run(self) -> None:
        """Work until cancelled; then hand over and end."""
        await self._worker.run(self._watch(Stream.COLOR), self._watch(Stream.POINTS))

    def _details(self) -> dict[str, Any]:
        return {"model": METHOD, "busy_s": self._executor.busy_s}

    async def _watch(self, stream: Stream) -> None:
        async with self._bus.watch(keys.every_stream_alive(stream)) as watch:
            async for presence in watch:
                with suppress(SchemaError):  # work sharing reports keys that are not cameras
                    sensor = keys.parse_stream(presence.key)
                    self._sensors.note(sensor, alive=presence.alive)
                    self._changed.pop(sensor.camera.robot, asyncio.Event()).set()

    async def _serve(self, key: CameraKey, tally: Tally, took_over: Callable[[], None]) -> None:
        camera = self._camera(key, tally)

        async def work(publisher: Publisher) -> None:
            def publish(clouds: ObjectClouds) -> None:
                publisher.put(codec.encode(clouds))
                took_over()

            await self._follow_points(key, lambda points: camera.run(points, publish))

        clouds = ResultStream(key.stream(Stream.OBJECTS), ObjectClouds, QoS.IMAGE)
        await publish_while_wanted(self._bus, [clouds], work, took_over)

    def _camera(self, key: CameraKey, tally: Tally) -> CloudCamera:
        return CloudCamera(
            self._bus,
            key,
            tally,
            worker=self._settings.worker,
            executor=self._executor,
            limits=self._settings.limits,
            target_frame=self._settings.target_frame,
            tolerance_ns=self._settings.tolerance_ns,
            budget=self._budget,
        )

    async def _follow_points(self, key: CameraKey, work: Callable[[CameraKey], Coroutine[None, None, None]]) -> None:
        """Work with the camera's points, from whichever sensor has them, until cancelled."""
        while True:
            points = self._sensors.points_of(key)
            async with asyncio.TaskGroup() as group:
                working = None if points is None else group.create_task(work(points))
                while self._sensors.points_of(key) == points:
                    await self._changed[key.robot].wait()
                if working is not None:
                    working.cancel()


async def run(settings: CloudSettings) -> None:
    """Run a worker until cancelled."""
    with worker_thread("cloud") as executor:
        async with open_bus(settings) as bus:
            log.info("cloud worker %s is ready", settings.worker)
            await CloudWorker(bus, settings, executor).run()
