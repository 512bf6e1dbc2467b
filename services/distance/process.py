"""The distance process: joins the bus and works."""

import logging
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Final

from bus import Bus, Publisher, QoS, open_bus
from bus.sharing.sharing import JOIN_S
from bus.sharing.work_counts import Tallies
from schemas.distances import CameraView, Distances
from schemas.keys import CameraKey, Stream
from services.distance.camera import DistanceCamera, Viewing, work
from services.distance.camera_views import ViewMaker
from services.distance.depth_in_color_view import Views
from services.distance.sensor_history import DEPTH_IMAGE, SensorHistory
from services.distance.sensor_input import DetectionCounts
from services.distance.settings import DistanceSettings
from services.geometry.memory_budget import MIB, MemoryBudget
from services.geometry.transforms import TransformTree
from services.worker.stamp_joiner import Joiner
from services.worker.thread import TimedExecutor, worker_thread
from services.worker.worker import ResultStream, Worker, publish_while_wanted

SERVICE: Final = "distance"


class DistanceWorker:
    """Serves the cameras assigned to this worker. executor: runs the arithmetic, off the event loop."""

    def __init__(self, bus: Bus, settings: DistanceSettings, executor: Executor, *, join_s: float = JOIN_S) -> None:
        self._bus = bus
        self._settings = settings
        self._executor = TimedExecutor(executor)
        self._budget = MemoryBudget(settings.memory_mib * MIB)
        self._worker = Worker(
            bus,
            settings.tokens(SERVICE),
            Tallies(DetectionCounts),
            self._serve,
            details=lambda: {"busy_s": self._executor.busy_s},
            pending=self._executor.pending,
            join_s=join_s,
        )

    async def run(self) -> None:
        """Work until cancelled; then hand over and end."""
        await self._worker.run()

    async def _serve(self, key: CameraKey, tally: DetectionCounts, took_over: Callable[[], None]) -> None:
        async def measure(distances: Publisher, views: Publisher) -> None:
            await work(self._bus, self._camera(tally, views), distances, took_over)

        streams = (
            ResultStream(key.stream(Stream.DISTANCES), Distances, QoS.RESULT),
            ResultStream(key.stream(Stream.VIEW), CameraView, QoS.IMAGE),
        )
        await publish_while_wanted(self._bus, streams, measure, took_over)

    def _camera(self, tally: DetectionCounts, views: Publisher) -> DistanceCamera:
        return DistanceCamera(
            tally=tally,
            sensed=SensorHistory(
                self._settings.frames,
                Joiner(DEPTH_IMAGE, tolerance_ns=self._settings.tolerance_ns, budget=self._budget),
                TransformTree(budget=self._budget),
            ),
            views=Views(self._settings.limits),
            criteria=self._settings.criteria,
            worker=self._settings.worker,
            executor=self._executor,
            viewing=Viewing(
                views,
                ViewMaker(self._settings.criteria, self._settings.worker),
                self._settings.view_frame,
                1 / self._settings.view_hz,
            ),
        )


log = logging.getLogger(__name__)


async def run(settings: DistanceSettings) -> None:
    """Run a worker until cancelled."""
    with worker_thread("distance") as executor:
        async with open_bus(settings) as bus:
            log.info("distance worker %s is ready", settings.worker)
            await DistanceWorker(bus, settings, executor).run()
