"""A program at the centre that subscribes to what the fleet makes, and notes how far each part of it is."""

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from typing import Any, Final, Self

from benchmarks.chaos.accounts import PALLET
from bus import LATEST, QUEUE, Bus, RequestError, Sample
from schemas import codec, keys, worker_keys
from schemas.alerts import Alert
from schemas.codec import M
from schemas.detections import ClassList
from schemas.distances import Distances
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.inventory import InventoryAnswer, InventoryRequest
from schemas.keys import CameraKey, Stream
from schemas.objects import ObjectClouds
from schemas.status import GatewayStatus, WorkerStatus
from schemas.world import SiteStatus

FRONT: Final = CameraKey("r1", "camera")
ASK_S: Final = 1.0

LISTS: Final = "class lists"
DISTANCES: Final = "distances"
CLOUDS: Final = "object clouds"
WORLD: Final = "world model"


@dataclass
class Seen:
    """What came so far. newest_ns: when the gateway had the newest frame of each result; of the world, the newest view.

    ages: arrival and age of each class list, in seconds. images: how many came. gateways, workers: the last status of
    each process. alerts: their ids. problems: what the monitor said of itself.
    """

    newest_ns: dict[str, int] = field(default_factory=dict)
    ages: list[tuple[float, float]] = field(default_factory=list)
    images: int = 0
    image_bytes: int = 0
    gateways: dict[str, GatewayStatus] = field(default_factory=dict)
    workers: dict[tuple[str, str], WorkerStatus] = field(default_factory=dict)
    alerts: set[str] = field(default_factory=set)
    problems: set[str] = field(default_factory=set)

    def forget(self) -> None:
        """Begin anew to note ages, images and problems."""
        self.ages.clear()
        self.problems.clear()
        self.images = self.image_bytes = 0

    def classes(self, seen: ClassList) -> None:
        """Note a class list."""
        now_s = time.time()
        self.ages.append((now_s, now_s - seen.header.received_ns / 1e9))
        self._note(LISTS, seen.header.received_ns)

    def distances(self, seen: Distances) -> None:
        """Note distances."""
        self._note(DISTANCES, seen.header.received_ns)

    def clouds(self, seen: ObjectClouds) -> None:
        """Note object clouds."""
        self._note(CLOUDS, seen.header.received_ns)

    def world(self, seen: SiteStatus) -> None:
        """Note a world model's status: how new the newest view is that it has."""
        self._note(WORLD, max((each.last_ns for each in seen.robots), default=0))

    def gateway(self, seen: GatewayStatus) -> None:
        """Note a gateway's account."""
        self.gateways[seen.boot_id] = seen

    def worker(self, seen: WorkerStatus) -> None:
        """Note a worker's account."""
        self.workers[seen.service, seen.worker] = seen

    def alert(self, seen: Alert) -> None:
        """Note an alert."""
        if seen.name == PALLET:
            self.alerts.add(seen.id)

    def image(self, seen: ImageFrame) -> None:
        """Note an image."""
        self.images += 1
        self.image_bytes += len(seen.data)

    def _note(self, what: str, at_ns: int) -> None:
        self.newest_ns[what] = at_ns


class Observer:
    """Subscribes for as long as the context lasts."""

    def __init__(self, bus: Bus) -> None:
        self.seen = Seen()
        self._bus = bus
        self._stack = AsyncExitStack()
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        seen = self.seen
        self._follow(FRONT.stream(Stream.CLASSES), ClassList, seen.classes)
        self._follow(FRONT.stream(Stream.DISTANCES), Distances, seen.distances)
        self._follow(FRONT.stream(Stream.OBJECTS), ObjectClouds, seen.clouds)
        self._follow(worker_keys.EVERY_WORLD_STATUS, SiteStatus, seen.world)
        self._follow(str(keys.RobotStreamKey(FRONT.robot, keys.ALERTS)), Alert, seen.alert)
        self._follow(keys.EVERY_GATEWAY_STATUS, GatewayStatus, seen.gateway)
        self._follow(worker_keys.EVERY_WORKER_STATUS, WorkerStatus, seen.worker)
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _follow(self, key: str, schema: type[M], take: Callable[[M], None]) -> None:
        self._tasks.append(asyncio.create_task(self.follow(key, schema, take)))

    async def follow(self, key: str, schema: type[M], take: Callable[[M], None], *, images: bool = False) -> None:
        """Take messages until cancelled."""
        keep: Any = LATEST if images else QUEUE(1_000)
        async with self._bus.subscribe(key, keep, history=False, few=True) as samples:
            async for sample in samples:
                for message in _decoded(schema, sample):
                    take(message)

    async def watch_images(self) -> None:
        """Want the camera's images, until cancelled."""
        await self.follow(FRONT.stream(Stream.COLOR), ImageFrame, self.seen.image, images=True)

    async def answer(self) -> InventoryAnswer | None:
        """Return the monitor's answer to a question; None if there is none."""
        with suppress(RequestError, SchemaError):
            request = codec.encode(InventoryRequest(robot=FRONT.robot, in_view=True))
            encoding = codec.encoding(InventoryRequest)
            reply = await self._bus.request(keys.INVENTORY, request, encoding=encoding, timeout_s=ASK_S)
            return codec.decode(InventoryAnswer, reply.payload, reply.encoding)
        return None

    async def note_problems(self) -> None:
        """Note what the monitor says of its problems, until cancelled."""
        while True:
            await asyncio.sleep(ASK_S)
            if (answer := await self.answer()) is not None:
                self.seen.problems.update(answer.problems)


def _decoded(schema: type[M], sample: Sample) -> Iterator[M]:
    with suppress(SchemaError):
        yield codec.decode(schema, sample.payload, sample.encoding)
