"""A small fleet on the real bus: one robot whose camera always sees the same, a worker, a monitor and a world model."""

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from bus import Bus, BusSettings, Publisher, QoS, RefusedError, Reply, Request, open_bus
from schemas import codec, keys, worker_keys
from schemas.alerts import Alert, AlertState, Severity
from schemas.codec import Message
from schemas.detections import Box, Detection, Detections, class_list
from schemas.distances import Distances, Measured, ObjectDistance, Place
from schemas.inventory import ClassSighting, InventoryAnswer, InventoryRequest
from schemas.keys import CameraKey, Stream
from schemas.objects import ObjectCloud, ObjectClouds, Shape, UprightBox
from schemas.worker_keys import WorkerAlive, WorldStream, world_key
from schemas.world import WorldAnswer, WorldObject, WorldRequest
from tests.contract.conftest import free_endpoint
from tests.schemas.frames import header, image
from tests.waiting import PATIENCE_S

FRONT: Final = CameraKey("r1", "front")
PERIOD_S: Final = 0.05
NO_IMAGE: Final = b"no image"

FOUND: Final = Detections(
    header=header(),
    height=4,
    width=6,
    objects=[
        Detection(name="box", score=0.75, box=Box(1.0, 1.0, 3.0, 4.0), track=1),
        Detection(name="box", score=0.5, box=Box(4.0, 1.0, 6.0, 4.0)),
    ],
    model="stand-in",
    worker="w1",
)
MEASURED: Final = Measured(
    axial_m=2.5, euclidean_m=2.6, mean_m=2.5, nearest_m=2.4, spread_m=0.1, places=[Place(frame_id="map", at=(1, 2, 3))]
)
FAR: Final = Distances(
    header=header(),
    objects=[
        ObjectDistance(name="box", index=0, track=1, valid_share=1.0, measured=MEASURED),
        ObjectDistance(name="box", index=1, valid_share=0.0, unknown="no reading"),
    ],
    model="stand-in",
    worker="w1",
)
SHAPE: Final = Shape(centroid=(0, 0, 2), box=UprightBox(centre=(0, 0, 2), size=(1, 1, 1), yaw=0))
CLOUDS: Final = ObjectClouds(
    header=header(),
    objects=[
        ObjectCloud(
            name="box",
            label=0,
            index=0,
            xyz=memoryview(np.zeros((2, 3), "<f4").tobytes()),
            rgb=memoryview(b""),
            shape=SHAPE,
        )
    ],
    model="stand-in",
    worker="w1",
)
ALERT: Final = Alert(
    id="a1",
    rule="in the way",
    severity=Severity.WARNING,
    state=AlertState.RAISED,
    robot="r1",
    camera="front",
    name="box",
    text="a box stands in the way",
    raised_ns=1,
    changed_ns=1,
)
SIGHTING: Final = ClassSighting(
    robot="r1",
    camera="front",
    name="box",
    count=2,
    score=0.75,
    first_ns=1,
    last_ns=2,
    model="stand-in",
    worker="w1",
    available=True,
)


PALLET: Final = WorldObject(
    id="h-1",
    site="hall",
    name="pallet",
    at=(2.0, 1.0, 0.5),
    covariance=(0.01, 0.0, 0.0, 0.01, 0.0, 0.01),
    size=(1.2, 0.8, 1.0),
    existence=0.9,
    first_ns=1,
    last_ns=2,
)


@dataclass(frozen=True, slots=True)
class StandIn:
    """Where the fleet is, and its bus, for its event loop alone. wanted: by stream, whether somebody wants it now."""

    endpoint: str
    bus: Bus
    publishers: dict[str, Publisher] = field(default_factory=dict)

    def wanted(self, stream: Stream) -> bool:
        return self.publishers[FRONT.stream(stream)].wanted


async def _infer(asked: Request) -> Reply:
    if asked.payload == NO_IMAGE:
        raise RefusedError("not an image")
    return Reply(codec.encode(FOUND), codec.encoding(Detections))


async def _inventory(asked: Request) -> Reply:
    question = codec.decode(InventoryRequest, asked.payload, asked.encoding)
    sightings = [SIGHTING] if question.robot in {"", "r1"} else []
    answer = InventoryAnswer(now_ns=3, sightings=sightings)
    return Reply(codec.encode(answer), codec.encoding(InventoryAnswer))


async def _world(asked: Request) -> Reply:
    question = codec.decode(WorldRequest, asked.payload, asked.encoding)
    objects = [PALLET] if question.name in {"", PALLET.name} and not question.region else []
    answer = WorldAnswer(site="hall", epoch="e", last=1, now_ns=3, objects=objects)
    return Reply(codec.encode(answer), codec.encoding(WorldAnswer))


@asynccontextmanager
async def stand_in(*, worker: bool = True, monitor: bool = True) -> AsyncIterator[StandIn]:
    """Run the fleet on this event loop, with a router of its own."""
    endpoint = free_endpoint()
    async with (
        open_bus(BusSettings(mode="router", listen=[endpoint])) as bus,
        asyncio.TaskGroup() as group,
        AsyncExitStack() as stack,
    ):
        made = StandIn(endpoint, bus)

        async def publish(key: str, qos: QoS, message: Message) -> None:
            publisher = await stack.enter_async_context(bus.publisher(key, qos, encoding=codec.encoding(type(message))))
            made.publishers[key] = publisher
            publisher.put(codec.encode(message))

        await publish(FRONT.stream(Stream.DISTANCES), QoS.RESULT, FAR)
        await publish(FRONT.stream(Stream.OBJECTS), QoS.IMAGE, CLOUDS)
        await publish(FRONT.stream(Stream.COLOR), QoS.IMAGE, image())
        await publish(f"fleet/r1/{keys.ALERTS}", QoS.RESULT, ALERT)
        tokens = [keys.robot_alive("r1"), FRONT.alive(Stream.COLOR)]
        if worker:
            await publish(FRONT.stream(Stream.CLASSES), QoS.RESULT, class_list(FOUND))
            await publish(FRONT.stream(Stream.DETECTIONS), QoS.RESULT, FOUND)
            tokens.append(str(WorkerAlive("detector", "w1")))
            await stack.enter_async_context(bus.serve(worker_keys.infer("w1"), _infer))
        for token in tokens:
            await stack.enter_async_context(bus.announce(token))
        if monitor:
            await stack.enter_async_context(bus.serve(keys.INVENTORY, _inventory))
            await stack.enter_async_context(bus.serve(world_key("hall", WorldStream.OBJECTS), _world))
        images = group.create_task(_send_images(made))
        yield made
        images.cancel()


async def _send_images(made: StandIn) -> None:
    color = made.publishers[FRONT.stream(Stream.COLOR)]
    clouds = made.publishers[FRONT.stream(Stream.OBJECTS)]
    seq = 0
    while True:
        await asyncio.sleep(PERIOD_S)
        if color.wanted:
            seq += 1
            color.put(codec.encode(image(seq=seq)))
        if clouds.wanted:
            clouds.put(codec.encode(CLOUDS))


@contextmanager
def in_a_thread() -> Iterator[str]:
    """Run the fleet on an event loop of its own; give the endpoint it is found at."""
    ready, endpoints = threading.Event(), list[str]()
    loop = asyncio.new_event_loop()
    end = asyncio.Event()

    async def run() -> None:
        async with stand_in() as made:
            endpoints.append(made.endpoint)
            ready.set()
            await end.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(run()))
    thread.start()
    try:
        assert ready.wait(PATIENCE_S)
        yield endpoints[0]
    finally:
        loop.call_soon_threadsafe(end.set)
        thread.join()
        loop.close()
