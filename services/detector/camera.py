"""One camera at a worker: its publishers, and its frames on their way to the model while somebody wants results."""

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from bus import LATEST, Bus, Publisher, QoS, Sample
from bus.clock import clock_id
from bus.shared_demand import SharedDemand, while_wanted
from schemas import codec
from schemas.detections import ClassList, Detections, class_list
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey, Wanted
from services.detector.account import DEPTH, REPLACED, UNWANTED, Account
from services.detector.board import Board, Waiting
from services.detector.pixels import shows_colours

log = logging.getLogger(__name__)


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


async def feed(bus: Bus, camera: Camera, board: Board, consumer: str) -> None:
    """Put the camera's newest frame on the board whenever its results are wanted, for ever.

    consumer: the name under which the gateway is told where its frames go.
    """
    token = str(Wanted(StreamKey(camera.key, Stream.COLOR), clock_id(), consumer))

    async def receive() -> None:
        camera.account.begin()
        try:
            async with (
                bus.announce(token),
                bus.subscribe(camera.key.stream(Stream.COLOR), LATEST, history=False) as frames,
            ):
                async for sample in frames:
                    accept(camera, board, sample)
        finally:
            camera.account.dropped[UNWANTED] += board.discard(camera.key)

    await while_wanted(camera.demand, receive)


def accept(camera: Camera, board: Board, sample: Sample) -> None:
    """Put a frame on the board, or count why not."""
    try:
        frame = codec.decode(ImageFrame, sample.payload, sample.encoding)
        codec.check_identity(frame.header, camera.key)
    except SchemaError as error:
        camera.account.malformed(sample.replaced)
        log.warning("%s: frame left out: %s", camera.key, error)
        return
    camera.account.arrived(frame.header, sample.replaced)
    if not shows_colours(frame):
        camera.account.dropped[DEPTH] += 1
        return
    camera.account.dropped[REPLACED] += board.post(camera.key, Waiting(frame, sample.received_ns))
