"""A worker fed over the real bus, by cameras that send their next frame when they have had the last one's result."""

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import count
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.detector.report import Overhead
from bus import QUEUE, Bus, Publisher, QoS, Subscription
from schemas import codec
from schemas.detections import ClassList, Detections
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream

Pictures = Sequence[NDArray[np.uint8]]
"""Height x width x 3 in BGR."""

CAMERAS: Final = 4
TIMEOUT_S: Final = 300.0
LOST_S: Final = 2.0


class Camera:
    """Sends the pictures in turn."""

    def __init__(self, key: CameraKey, publisher: Publisher, pictures: Pictures) -> None:
        self.key = key
        self.publisher = publisher
        self._pictures = [np.ascontiguousarray(picture[..., ::-1]).tobytes() for picture in pictures]
        self._size = pictures[0].shape[:2]
        self._numbers = count()

    def send(self) -> None:
        """Put the next frame on the bus, as a gateway that has just received it does."""
        seq = next(self._numbers)
        height, width = self._size
        now = time.time_ns()
        frame = ImageFrame(
            header=Header(
                robot=self.key.robot,
                camera=self.key.camera,
                boot_id="benchmark",
                seq=seq,
                stamp_ns=now,
                frame_id="camera",
                received_ns=now,
            ),
            height=height,
            width=width,
            encoding="rgb8",
            step=width * 3,
            data=memoryview(self._pictures[seq % len(self._pictures)]),
        )
        self.publisher.put(codec.encode(frame))


@asynccontextmanager
async def cameras(bus: Bus, number: int, pictures: Pictures) -> AsyncIterator[dict[str, Camera]]:
    """Have cameras, by the key of what the worker says of them, that are there but send nothing by themselves."""
    async with AsyncExitStack() as stack:
        made = {}
        for n in range(number):
            key = CameraKey("r1", f"c{n}")
            stream = key.stream(Stream.COLOR)
            publisher = await stack.enter_async_context(
                bus.publisher(stream, QoS.IMAGE, encoding=codec.encoding(ImageFrame))
            )
            await stack.enter_async_context(bus.announce(key.alive(Stream.COLOR)))
            made[str(key)] = Camera(key, publisher, pictures)
        yield made


async def frames(bus: Bus, pictures: Pictures, *, seconds: float = 0, frames: int = 0) -> float:
    """Keep a worker busy for so long or for so many frames, masks and all; return results per second."""
    async with (
        cameras(bus, CAMERAS, pictures) as sources,
        bus.subscribe("fleet/*/*/detections", QUEUE(1000), history=False) as results,
    ):
        await _wanted(sources)
        for camera in sources.values():
            camera.send()
        for _ in range(CAMERAS):
            await _next(results, sources)
        began, done = time.monotonic(), 0
        while time.monotonic() - began < seconds or done < frames:
            await _next(results, sources)
            done += 1
        return done / (time.monotonic() - began)


async def _wanted(sources: dict[str, Camera]) -> None:
    async with asyncio.timeout(TIMEOUT_S):
        while not all(camera.publisher.wanted for camera in sources.values()):  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.01)


async def _next(results: Subscription, sources: dict[str, Camera]) -> None:
    try:
        async with asyncio.timeout(LOST_S):
            sample = await anext(results)
    except TimeoutError:
        for camera in sources.values():
            camera.send()
        return
    found = codec.decode(Detections, sample.payload, sample.encoding)
    sources[f"{found.header.robot}/{found.header.camera}"].send()


async def overheads(bus: Bus, pictures: Pictures, *, hz: float, number: int) -> list[Overhead]:
    """Return each frame's way from the gateway that received it to its class list, less the model's call."""
    found = []
    async with (
        cameras(bus, 1, pictures) as sources,
        bus.subscribe("fleet/*/*/classes", QUEUE(1000), history=False) as results,
    ):
        await _wanted(sources)
        (camera,) = sources.values()
        for _ in range(number):
            camera.send()
            began = time.monotonic()
            try:
                async with asyncio.timeout(LOST_S):
                    sample = await anext(results)
            except TimeoutError:
                continue
            seen = codec.decode(ClassList, sample.payload, sample.encoding)
            found.append(Overhead.of(sample.received_ns - seen.header.received_ns, seen.spans))
            await asyncio.sleep(max(0.0, 1 / hz - (time.monotonic() - began)))
    return found
