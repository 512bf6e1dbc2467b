"""A small warehouse on a bus: a robot whose results are made while somebody wants them."""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np

from bus import Bus, Publisher, QoS
from schemas import codec, keys, worker_keys
from schemas.detections import ClassCount, ClassList
from schemas.distances import Distances, Measured, ObjectDistance, Place
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey, RobotStreamKey, Stream
from schemas.objects import ObjectCloud, ObjectClouds, Shape, UprightBox
from schemas.status import CameraLoad, GatewayStatus, WorkerStatus
from schemas.transforms import Transform, Transforms

CLOCK = "clock"
PERIOD_S = 0.1
THINGS = (("box", 2.5, 0.8, 0.5), ("box", 4.0, -0.6, 0.4), ("pallet", 3.2, -1.4, 0.15), ("forklift", 5.5, 1.6, 1.0))
"""Class, metres ahead, to the left and above the floor of the middle of each thing."""

EAST_M = 1.0
"""Where robots are in the map as their distances say it; their transforms say that they drive in a circle."""

COLOURS = {"box": (176, 124, 68), "pallet": (205, 170, 115), "forklift": (236, 180, 20)}
SIZES = {"box": (0.6, 0.5, 0.8), "pallet": (1.2, 0.8, 0.15), "forklift": (1.6, 1.0, 2.0)}


@dataclass
class Robot:
    """One robot with one camera. wanted: which streams somebody subscribes to now.

    flickers: a class that is found in every other frame as well; empty for none.
    """

    name: str
    publishers: dict[str, Publisher]
    seq: int = 0
    flickers: str = ""

    @property
    def wanted(self) -> set[str]:
        return {key.split("/", 2)[2] for key, publisher in self.publishers.items() if publisher.wanted}

    def header(self, camera: str = "front") -> Header:
        now_ns = time.time_ns()
        return Header(
            robot=self.name,
            camera=camera,
            boot_id="boot",
            seq=self.seq,
            stamp_ns=now_ns,
            frame_id="base_link",
            received_ns=now_ns,
        )

    def messages(self) -> Iterator[tuple[str, codec.Message]]:
        """Yield what it and its workers say now, by key."""
        camera = CameraKey(self.name, "front")
        self.seq += 1
        yield camera.stream(Stream.CLASSES), self._classes()
        yield camera.stream(Stream.DISTANCES), self._distances()
        for stream in (Stream.OVERLAY_DETECTION, Stream.OVERLAY_SEGMENTATION):
            yield camera.stream(stream), self._overlay(stream)
        yield camera.stream(Stream.OBJECTS), self._objects()
        yield str(RobotStreamKey(self.name, keys.TF)), self._transforms()
        yield (
            keys.gateway_status(self.name),
            GatewayStatus(robot=self.name, boot_id="boot", clock_id=CLOCK, sent_ns=time.time_ns()),
        )

    def workers(self) -> tuple[WorkerStatus, ...]:
        """Return what the workers that serve it say."""
        return worker("detector", f"d-{self.name}", (self.name,)), worker("cloud", f"c-{self.name}", (self.name,))

    def _place(self) -> tuple[float, float, float]:
        turn = self.seq / 50 + int(self.name[1:])
        return math.cos(turn), math.sin(turn), turn + math.pi / 2

    def _classes(self) -> ClassList:
        names = [name for name, *_ in THINGS]
        if self.flickers and self.seq % 2:
            names.append(self.flickers)
        seen = [ClassCount(name, names.count(name), 0.9) for name in sorted(set(names))]
        return ClassList(header=self.header(), classes=seen, model="warehouse.pt", worker="w1")

    def _distances(self) -> Distances:
        objects = [
            ObjectDistance(
                name=name,
                index=index,
                track=index + 1,
                valid_share=1.0,
                measured=Measured(
                    axial_m=ahead,
                    euclidean_m=math.hypot(ahead, left),
                    mean_m=ahead,
                    nearest_m=ahead,
                    spread_m=0.0,
                    places=[
                        Place(frame_id="base_link", at=(ahead - EAST_M, left, up)),
                        Place(frame_id="map", at=(ahead, left, up)),
                    ],
                ),
            )
            for index, (name, ahead, left, up) in enumerate(THINGS)
        ]
        return Distances(header=self.header(), objects=objects, model="warehouse.pt", worker="w2")

    def _overlay(self, stream: Stream) -> ImageFrame:
        picture = np.full((240, 320, 3), 90, np.uint8)
        picture[150:] = 120
        for name, ahead, left, _ in THINGS:
            x, size = round(160 - 140 * left / ahead), round(160 / ahead)
            filled = cv2.FILLED if stream is Stream.OVERLAY_SEGMENTATION else 2
            cv2.rectangle(picture, (x - size // 2, 170 - size), (x + size // 2, 170), COLOURS[name][::-1], filled)
        data = cv2.imencode(".jpg", picture)[1].tobytes()
        return ImageFrame(
            header=self.header(), height=240, width=320, encoding="rgb8", step=960, data=memoryview(data), format="jpeg"
        )

    def _objects(self) -> ObjectClouds:
        still = Transform(
            frame_id="base_link", child_frame_id="camera", stamp_ns=1, translation=(0, 0, 0), rotation=(0, 0, 0, 1)
        )
        objects = [_cloud(index, *thing) for index, thing in enumerate(THINGS)]
        return ObjectClouds(header=self.header(), objects=objects, model="warehouse.pt", worker="w3", target=still)

    def _transforms(self) -> Transforms:
        x, y, yaw = self._place()
        pose = Transform(
            frame_id="map",
            child_frame_id="base_link",
            stamp_ns=time.time_ns(),
            translation=(x, y, 0.0),
            rotation=(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
        )
        return Transforms(header=msgspec.structs.replace(self.header(), camera=""), transforms=[pose])


def _cloud(index: int, name: str, ahead: float, left: float, up: float) -> ObjectCloud:
    """Return points on the faces of a box."""
    random = np.random.default_rng(index)
    size = SIZES[name]
    offsets = random.uniform(-0.5, 0.5, (800, 3))
    offsets[np.arange(800), random.integers(0, 3, 800)] = random.choice((-0.5, 0.5), 800)
    xyz = (np.array([ahead, left, up]) + offsets * size).astype("<f4")
    shade = random.integers(-20, 20, (800, 1)) + np.array(COLOURS[name])
    shape = Shape(centroid=(ahead, left, up), box=UprightBox(centre=(ahead, left, up), size=size, yaw=0.0))
    return ObjectCloud(
        name=name,
        label=index,
        index=index,
        xyz=memoryview(xyz.tobytes()),
        rgb=memoryview(shade.clip(0, 255).astype(np.uint8).tobytes()),
        shape=shape,
        in_target=shape,
    )


def worker(service: str, name: str, robots: tuple[str, ...], *remarks: str) -> WorkerStatus:
    """Return what a worker says that serves the robots' cameras."""
    loads = [CameraLoad(robot=robot, camera="front", inferred=1, serving=True) for robot in robots]
    return WorkerStatus(
        service=service, worker=name, model="warehouse.pt", sent_ns=time.time_ns(), cameras=loads, remarks=list(remarks)
    )


SMALL = (ClassList, Distances, Transforms, GatewayStatus)


@asynccontextmanager
async def robot_on(bus: Bus, name: str = "r1") -> AsyncIterator[Robot]:
    """Have a robot on the bus, with a detector and a cloud worker that serve it."""
    async with AsyncExitStack() as stack:
        robot = Robot(name, {})
        for key, message in robot.messages():
            qos = QoS.RESULT if isinstance(message, SMALL) else QoS.IMAGE
            robot.publishers[key] = await stack.enter_async_context(
                bus.publisher(key, qos, encoding=codec.encoding(type(message)))
            )
        for status in robot.workers():
            key = worker_keys.worker_status(status.service, status.worker)
            robot.publishers[key] = await stack.enter_async_context(
                bus.publisher(key, QoS.STATUS, encoding=codec.encoding(WorkerStatus))
            )
        await stack.enter_async_context(bus.announce(keys.robot_alive(name)))
        await stack.enter_async_context(bus.announce(CameraKey(name, "front").alive(Stream.COLOR)))
        living = asyncio.create_task(_live(robot))
        try:
            yield robot
        finally:
            living.cancel()
            await asyncio.wait([living])


async def _live(robot: Robot) -> None:
    while True:
        for key, message in robot.messages():
            if robot.publishers[key].wanted:
                robot.publishers[key].put(codec.encode(message))
        for status in robot.workers():
            robot.publishers[worker_keys.worker_status(status.service, status.worker)].put(codec.encode(status))
        await asyncio.sleep(PERIOD_S)
