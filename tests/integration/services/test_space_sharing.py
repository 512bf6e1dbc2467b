"""Distance and cloud workers over a real router: those of a robot come first, and others take over from them."""

import asyncio
import itertools
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from functools import partial

import msgspec
import numpy as np
import pytest

from bus import QUEUE, Bus, BusSettings, QoS, open_bus
from schemas import codec, keys
from schemas.detections import Detections
from schemas.distances import Distances
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from services.toolbox.demo.children import free_ports
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.network.thin_link import ThinLink, thin_link
from tests.integration.services.serving import Result, served
from tests.services.cloud.clouds import xyz_cloud
from tests.services.distance.scenes import HEIGHT, WIDTH, depth, detections, found, mask, wall

R1, R2 = (CameraKey(robot, "front") for robot in ("r1", "r2"))
PERIOD_S = 0.05
COUNTED = 10
LINK_BYTES_PER_S = 100_000_000
BOX = found(mask(slice(10, 30), slice(20, 50)))
Measurement = ImageFrame | PointCloud
LEASE = ("--lease-s", "1")
OWN = ("--robots", "r1", *LEASE)


def points(seq: int) -> PointCloud:
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    flat = np.stack([columns / 50, rows / 50, np.full(rows.shape, 2.0)], axis=-1)
    return xyz_cloud(flat, header=depth(wall(), seq).header)


@dataclass(frozen=True)
class Service:
    """What a service joins detections with, and what it makes of them."""

    name: str
    stream: Stream
    schema: type[codec.Message]
    measured: Callable[[int], Measurement]
    result: type[Result]
    results: Stream


DISTANCE = Service("distance", Stream.DEPTH, ImageFrame, partial(depth, wall(2.0)), Distances, Stream.DISTANCES)
CLOUD = Service("cloud", Stream.POINTS, PointCloud, points, ObjectClouds, Stream.OBJECTS)


@asynccontextmanager
async def sensors(bus: Bus, camera: CameraKey, service: Service) -> AsyncIterator[None]:
    """Publish what a gateway and a detector would: a box before a camera."""
    sent: tuple[tuple[Stream, type[codec.Message], Callable[[int], Measurement | Detections]], ...] = (
        (service.stream, service.schema, service.measured),
        (Stream.DETECTIONS, Detections, partial(detections, BOX)),
    )
    async with AsyncExitStack() as stack:
        publishers = [
            await stack.enter_async_context(
                bus.publisher(camera.stream(stream), QoS.RESULT, encoding=codec.encoding(schema))
            )
            for stream, schema, _ in sent
        ]
        for stream in (Stream.COLOR, service.stream):
            await stack.enter_async_context(bus.announce(camera.alive(stream)))

        async def send() -> None:
            for seq in itertools.count():
                for publisher, (_, _, made) in zip(publishers, sent, strict=True):
                    message = made(seq)
                    header = msgspec.structs.replace(message.header, robot=camera.robot, camera=camera.camera)
                    publisher.put(codec.encode(msgspec.structs.replace(message, header=header)))
                await asyncio.sleep(PERIOD_S)

        sending = asyncio.create_task(send())
        try:
            yield
        finally:
            sending.cancel()
            await asyncio.wait([sending])


@asynccontextmanager
async def robot(central: FleetRig, service: Service) -> AsyncIterator[tuple[FleetRig, ThinLink]]:
    """Give where the workers of a robot connect whose gateway listens, and its link to the fleet's."""
    async with thin_link(int(central.endpoint.rpartition(":")[2]), LINK_BYTES_PER_S) as (link, through):
        port = free_ports(1)
        settings = BusSettings(
            listen=[f"tcp/127.0.0.1:{port}"],
            connect=[f"tcp/127.0.0.1:{through}"],
            shared_memory=False,  # it would pass the link by
        )
        async with open_bus(settings) as bus, sensors(bus, R1, service):
            yield central.at(port), link


@pytest.mark.parametrize("service", [DISTANCE, CLOUD], ids=lambda service: service.name)
@pytest.mark.timeout(180)
async def test_workers_beside_a_gateway_come_first_and_others_take_over(service: Service) -> None:
    async with (
        fleet_rig() as central,
        sensors(central.bus, R2, service),
        robot(central, service) as (on_robot, link),
        central.bus.subscribe(keys.every_stream(service.results), QUEUE(1000), history=False) as results,
    ):

        async def served_by(worker: str, in_a_row: int = 5) -> None:
            """Return once the one robot's camera is this worker's, and nobody else's any more."""
            so = {str(R1): worker, str(R2): "far"}
            await served(results, service.result, lambda owners: owners == so, in_a_row=in_a_row)

        _, near, spare = await asyncio.gather(
            central.start(service.name, "--worker", "far", *LEASE),
            on_robot.start(service.name, "--worker", "near", *OWN),
            on_robot.start(service.name, "--worker", "spare", *OWN, "--weight", "0.01"),
        )
        await served_by("near")
        passed = link.passed
        await served_by("near", COUNTED)
        assert link.passed - passed < COUNTED * len(codec.encode(service.measured(0)))
        near.process.terminate()
        await served_by("spare")
        for sent, heir in ((signal.SIGSTOP, "far"), (signal.SIGCONT, "spare"), (signal.SIGKILL, "far")):
            spare.process.send_signal(sent)
            await served_by(heir)
