"""The distance process: join the bus, work."""

import asyncio
import logging
import time
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Final

from bus import Bus, QoS, open_bus
from bus.demand import SharedDemand, while_wanted
from bus.reporting import VERSION, report
from bus.sharing import Sharing
from bus.sharing.sharing import JOIN_S, say_unwanted
from bus.sharing.tally import Tallies
from schemas import codec
from schemas.distances import Distances
from schemas.keys import CameraKey, Stream
from schemas.status import WorkerStatus
from schemas.worker_keys import worker_status
from services.distance.camera import DistanceCamera, work
from services.distance.sensor_history import DEPTH_IMAGE, SensorHistory
from services.distance.sensor_input import DetectionCounts
from services.distance.settings import DistanceSettings
from services.distance.views import Views
from services.geometry.memory_budget import MIB, MemoryBudget
from services.geometry.transforms import TransformTree
from services.worker.stamp_joiner import Joiner
from services.worker.thread import worker_thread

SERVICE: Final = "distance"


class DistanceWorker:
    """Serves the cameras that fall to it. executor: where the arithmetic runs, off the event loop."""

    def __init__(self, bus: Bus, settings: DistanceSettings, executor: Executor, *, join_s: float = JOIN_S) -> None:
        self._bus = bus
        self._settings = settings
        self._executor = executor
        self._budget = MemoryBudget(settings.memory_mib * MIB)
        self._accounts = Tallies(DetectionCounts)
        tokens = settings.tokens(SERVICE)
        self._sharing = Sharing(bus, tokens, Stream.COLOR, self._serve, join_s=join_s)

    async def run(self) -> None:
        """Work until cancelled; then hand over and end."""
        async with asyncio.TaskGroup() as group:
            key = worker_status(SERVICE, self._settings.worker)
            group.create_task(report(self._bus, key, WorkerStatus, self._status))
            await self._sharing.run()

    async def _serve(self, key: CameraKey, took_over: Callable[[], None]) -> None:
        demand = SharedDemand()
        with self._accounts.serving(key) as account:
            async with (
                self._bus.publisher(
                    key.stream(Stream.DISTANCES),
                    QoS.RESULT,
                    encoding=codec.encoding(Distances),
                    on_demand=demand.of(Stream.DISTANCES),
                ) as publisher,
                asyncio.TaskGroup() as group,
            ):
                group.create_task(say_unwanted(demand, took_over))
                await while_wanted(demand, lambda: work(self._bus, self._camera(account), publisher, took_over))

    def _camera(self, account: DetectionCounts) -> DistanceCamera:
        return DistanceCamera(
            account=account,
            sensed=SensorHistory(
                self._settings.frames,
                Joiner(DEPTH_IMAGE, tolerance_ns=self._settings.tolerance_ns, budget=self._budget),
                TransformTree(budget=self._budget),
            ),
            views=Views(self._settings.limits),
            criteria=self._settings.criteria,
            worker=self._settings.worker,
            executor=self._executor,
        )

    def _status(self) -> WorkerStatus:
        return WorkerStatus(
            service=SERVICE,
            worker=self._settings.worker,
            model="",
            sent_ns=time.time_ns(),
            cameras=self._accounts.loads(),
            version=VERSION,
        )


log = logging.getLogger(__name__)


async def run(settings: DistanceSettings) -> None:
    """Run a worker until cancelled."""
    with worker_thread("distance") as executor:
        async with open_bus(settings) as bus:
            log.info("distance worker %s is ready", settings.worker)
            await DistanceWorker(bus, settings, executor).run()
