"""One camera at a worker: its publishers and the demand for what they publish."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from bus import Bus, Publisher, QoS
from bus.shared_demand import SharedDemand
from schemas import codec
from schemas.detections import ClassList, Detections, class_list
from schemas.keys import CameraKey, Stream
from services.detector.account import Account


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera's results and the demand for them."""

    key: CameraKey
    account: Account
    demand: SharedDemand
    detections: Publisher
    classes: Publisher

    def publish(self, found: Detections) -> None:
        """Publish what somebody wants of the results."""
        if self.detections.wanted:
            self.detections.put(codec.encode(found))
        if self.classes.wanted:
            self.classes.put(codec.encode(class_list(found)))


@asynccontextmanager
async def serving(bus: Bus, key: CameraKey, account: Account) -> AsyncIterator[Camera]:
    """Declare a camera's result streams for as long as the context lasts."""
    demand = SharedDemand()
    async with (
        bus.publisher(
            key.stream(Stream.DETECTIONS),
            QoS.RESULT,
            encoding=codec.encoding(Detections),
            on_demand=demand.of(Stream.DETECTIONS),
        ) as detections,
        bus.publisher(
            key.stream(Stream.CLASSES),
            QoS.RESULT,
            encoding=codec.encoding(ClassList),
            on_demand=demand.of(Stream.CLASSES),
        ) as classes,
    ):
        yield Camera(key, account, demand, detections, classes)
