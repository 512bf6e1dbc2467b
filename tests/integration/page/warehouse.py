"""A small fleet on a real bus, without ROS and models, and a monitor that watches it."""

import asyncio
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import Any, Final

from bus import Bus, BusSettings, QoS, open_bus
from schemas import codec, keys, worker_keys
from schemas.detections import ClassCount, ClassList
from schemas.distances import Distances
from schemas.header import Header
from schemas.keys import CameraKey, Stream
from schemas.status import CameraLoad, GatewayStatus, StreamStatus, WorkerStatus
from services.monitor.inventory.sighting import Change
from services.monitor.monitor import Monitor
from services.monitor.process import watch_fleet
from services.toolbox.demo.children import free_ports
from tests.schemas.results import known
from tests.services.monitor.web.serving import monitor_on

PERIOD_S: Final = 0.2
MODEL: Final = "warehouse-n-seg"
CLOCK: Final = "clock"
"""The clock of the monitor that `monitor_on` makes: robots are on its machine."""


class Robot:
    """A robot with a camera, whose results are of a detector `gpu-1`.

    seen: how many of each class are in view from now on, None for no more class lists. flickers: what every other list
    says as well. waiting_for: what its gateway cannot go on without.
    """

    def __init__(
        self,
        name: str,
        seen: Mapping[str, int],
        *,
        camera: str = "front",
        flickers: Mapping[str, int] | None = None,
        waiting_for: str = "",
    ) -> None:
        self.key = CameraKey(name, camera)
        self._flickers = flickers or {}
        self.seen: Mapping[str, int] | None = seen
        self.waiting_for = waiting_for
        self._seq = 0

    async def drive(self, bus: Bus) -> None:
        """Be on the bus until cancelled."""
        async with AsyncExitStack() as stack:
            await stack.enter_async_context(bus.announce(keys.robot_alive(self.key.robot)))
            await stack.enter_async_context(bus.announce(self.key.alive(Stream.COLOR)))
            say = [
                (await stack.enter_async_context(bus.publisher(key, qos, encoding=codec.encoding(schema))), make)
                for key, qos, schema, make in (
                    (keys.gateway_status(self.key.robot), QoS.STATUS, GatewayStatus, self._status),
                    (self.key.stream(Stream.CLASSES), QoS.RESULT, ClassList, self._classes),
                    (self.key.stream(Stream.DISTANCES), QoS.RESULT, Distances, self._distances),
                )
            ]
            while True:
                self._seq += 1
                for publisher, make in say:
                    message = make()
                    if message is not None:
                        publisher.put(codec.encode(message))
                await asyncio.sleep(PERIOD_S)

    def _header(self) -> Header:
        now_ns = time.time_ns()
        robot, camera = self.key.robot, self.key.camera
        return Header(
            robot=robot, camera=camera, boot_id="b", seq=self._seq, stamp_ns=now_ns, frame_id="c", received_ns=now_ns
        )

    def _classes(self) -> ClassList | None:
        if self.seen is None:
            return None
        seen = {**self.seen, **self._flickers} if self._seq % 2 else self.seen
        counts = [ClassCount(name, count, 0.875) for name, count in seen.items()]
        return ClassList(header=self._header(), classes=counts, model=MODEL, worker="gpu-1")

    def _distances(self) -> Distances | None:
        if self.seen is None:
            return None
        objects = [known(name, 2.0, index) for index, name in enumerate(self.seen)]
        return Distances(header=self._header(), objects=objects, model=MODEL, worker="cpu-1")

    def _status(self) -> GatewayStatus:
        color = StreamStatus(
            camera=self.key.camera,
            stream="color",
            topic=f"/{self.key.camera}/color/image_raw",
            wanted=True,
            publishers=1,
            received=30 * self._seq,
            forwarded=5 * self._seq,
            dropped={"more than anybody can use": 25 * self._seq},
            received_hz=30.0,
            forwarded_hz=5.0,
            compression="jpeg:80",
        )
        return GatewayStatus(
            robot=self.key.robot,
            boot_id="b",
            clock_id=CLOCK,
            sent_ns=time.time_ns(),
            waiting_for=self.waiting_for,
            streams=[color],
            version="0.9",
        )


async def detector(bus: Bus, robots: Sequence[Robot]) -> None:
    """Be the detector that serves the robots' cameras, until cancelled."""
    encoding = codec.encoding(WorkerStatus)
    async with bus.publisher(
        worker_keys.worker_status("detector", "gpu-1"), QoS.STATUS, encoding=encoding
    ) as publisher:
        frames = 0
        while True:
            frames += 5
            loads = [
                CameraLoad(robot=robot.key.robot, camera=robot.key.camera, inferred=frames, serving=True)
                for robot in robots
            ]
            status = WorkerStatus(
                service="detector", worker="gpu-1", model=MODEL, sent_ns=time.time_ns(), cameras=loads, version="0.8"
            )
            publisher.put(codec.encode(status))
            await asyncio.sleep(PERIOD_S)


class Warehouse:
    """Robots that come and go, seen by a monitor. bus: that they are on."""

    def __init__(self, monitor: Monitor, bus: Bus) -> None:
        self.monitor = monitor
        self.bus = bus
        self._running: dict[str, asyncio.Task[None]] = {}

    def enter(self, robot: Robot) -> Robot:
        """Have a robot join."""
        self._running[robot.key.robot] = asyncio.create_task(robot.drive(self.bus))
        return robot

    def serve(self, robots: Sequence[Robot]) -> None:
        """Have a detector serve the robots' cameras."""
        self._running["detector"] = asyncio.create_task(detector(self.bus, robots))

    async def leave(self, *names: str) -> None:
        """Have robots go; all that is there if none are named."""
        for name in names or list(self._running):
            task = self._running.pop(name)
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task


@asynccontextmanager
async def warehouse(**settings: Any) -> AsyncIterator[Warehouse]:
    """Run a monitor, all but its terminal and its page, on a bus of its own, and an empty fleet that connects to it."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with (
        open_bus(BusSettings(mode="router", listen=[endpoint])) as central,
        open_bus(BusSettings(mode="client", connect=[endpoint])) as fleet,
    ):
        monitor = monitor_on(central, **settings)
        await monitor.rules.load()
        await monitor.history.restore()
        watching = asyncio.create_task(_watch(monitor))
        made = Warehouse(monitor, fleet)
        try:
            yield made
        finally:
            await made.leave()
            watching.cancel()
            with suppress(asyncio.CancelledError):
                await watching


async def _watch(monitor: Monitor) -> None:
    history, alerting = monitor.history, monitor.alerting

    def told(changes: Sequence[Change]) -> None:
        history.take(changes)
        alerting.take(changes)

    async with asyncio.TaskGroup() as group:
        group.create_task(monitor.health.run())
        group.create_task(history.run())
        group.create_task(alerting.run(monitor.bus, keep=history.alert, leads=lambda: history.status.leads))
        group.create_task(watch_fleet(monitor.bus, monitor.fleet, told, alerting.measured))
