"""Distance and cloud workers over a real router: those of a robot come first, and others take over from them."""

import asyncio
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from functools import partial

import msgspec
import numpy as np
import pytest

from bus import QUEUE, Bus, Publisher, QoS
from schemas import codec, keys
from schemas.detections import Detections
from schemas.distances import Distances
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from tests.integration.fleet import fleet_rig
from tests.integration.serving import Result, served
from tests.services.cloud.clouds import xyz_cloud
from tests.services.distance.scenes import HEIGHT, WIDTH, depth, detections, found, mask, wall

CAMERAS = [CameraKey(robot, "front") for robot in ("r1", "r2")]
PERIOD_S = 0.05
BOX = found(mask(slice(10, 30), slice(20, 50)))
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
    measured: Callable[[int], ImageFrame | PointCloud]
    result: type[Result]
    results: Stream


DISTANCE = Service("distance", Stream.DEPTH, ImageFrame, partial(depth, wall(2.0)), Distances, Stream.DISTANCES)
CLOUD = Service("cloud", Stream.POINTS, PointCloud, points, ObjectClouds, Stream.OBJECTS)


@asynccontextmanager
async def sensors(bus: Bus, service: Service) -> AsyncIterator[None]:
    """Publish what gateways and detectors of two robots would: a box before each camera."""

    async def send(camera: CameraKey, detected: Publisher, sensed: Publisher) -> None:
        for seq in range(10_000):
            for publisher, message in ((sensed, service.measured(seq)), (detected, detections(BOX, seq))):
                header = msgspec.structs.replace(message.header, robot=camera.robot, camera=camera.camera)
                publisher.put(codec.encode(msgspec.structs.replace(message, header=header)))
            await asyncio.sleep(PERIOD_S)

    async with AsyncExitStack() as stack:
        tasks = []
        for camera in CAMERAS:
            made = []
            for each, kind in ((Stream.DETECTIONS, Detections), (service.stream, service.schema)):
                publisher = bus.publisher(camera.stream(each), QoS.RESULT, encoding=codec.encoding(kind))
                made.append(await stack.enter_async_context(publisher))
            for each in (Stream.COLOR, service.stream):
                await stack.enter_async_context(bus.announce(camera.alive(each)))
            tasks.append(asyncio.create_task(send(camera, *made)))
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)


@pytest.mark.parametrize("service", [DISTANCE, CLOUD], ids=lambda service: service.name)
@pytest.mark.timeout(180)
async def test_workers_of_a_robot_come_first_and_others_take_over(service: Service) -> None:
    async with (
        fleet_rig() as rig,
        sensors(rig.bus, service),
        rig.bus.subscribe(keys.every_stream(service.results), QUEUE(1000), history=False) as results,
    ):

        async def served_by(worker: str) -> None:
            """Return once the one robot's camera is this worker's, and nobody else's any more."""
            so = {"r1/front": worker, "r2/front": "far"}
            await served(results, service.result, lambda owners: owners == so, in_a_row=5)

        _, near, spare = await asyncio.gather(
            rig.start(service.name, "--worker", "far", *LEASE),
            rig.start(service.name, "--worker", "near", *OWN),
            rig.start(service.name, "--worker", "spare", *OWN, "--weight", "0.01"),
        )
        await served_by("near")
        near.process.terminate()
        await served_by("spare")
        for sent, heir in ((signal.SIGSTOP, "far"), (signal.SIGCONT, "spare"), (signal.SIGKILL, "far")):
            spare.process.send_signal(sent)
            await served_by(heir)
