"""A flood of masks at a distance worker of its own: how much memory it takes, and how long another robot waits."""

import asyncio
import itertools
import time
from contextlib import suppress
from typing import Any, Final

import cv2
import msgspec
import numpy as np

from benchmarks.gateway.flow import free_endpoint
from benchmarks.gateway.processes import PeerError, Process, running
from benchmarks.monitor.scenario import TOOLBOX
from bus import QUEUE, Bus, BusSettings, Subscription, open_bus
from schemas import codec, keys
from schemas.compression import PNG
from schemas.detections import Detections
from schemas.distances import Distances
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from tests.services.distance import scenes
from tests.services.distance.rig import Robot, robot
from tests.services.geometry.cameras import info

MASKS: Final = 1_000
SIDE: Final = 4_096
PERIOD_S: Final = 0.2
"""Between two frames of each robot."""

START_S: Final = 60.0
LOST_S: Final = 20.0
"""A frame that is not answered after this counts as lost."""

BAD: Final = CameraKey("invented", "front")
GOOD: Final = CameraKey("r1", "front")


def huge_frame() -> tuple[Detections, ImageFrame]:
    """Return detections of MASKS objects, each a mask of the whole image, and the depth image that they belong to."""
    whole = scenes.found(np.ones((SIDE, SIDE), np.bool_))[0]
    seen = msgspec.structs.replace(scenes.detections([]), height=SIDE, width=SIDE, objects=[whole] * MASKS)
    made, png = cv2.imencode(".png", np.full((SIDE, SIDE), 2_000, np.uint16))
    if not made:
        raise PeerError("no PNG file could be made")
    depth = ImageFrame(
        header=seen.header,
        height=SIDE,
        width=SIDE,
        encoding="16UC1",
        step=2 * SIDE,
        data=memoryview(png.tobytes()),
        format=PNG,
    )
    return seen, depth


def small_frame() -> tuple[Detections, ImageFrame]:
    """Return the detections of one object, and its depth image."""
    box = scenes.found(scenes.mask(slice(10, 30), slice(10, 30)))
    return scenes.detections(box), scenes.depth(scenes.wall())


def named(message: Any, camera: CameraKey, seq: int) -> Any:
    """Return a message as that of a camera's frame of now."""
    about = msgspec.structs.replace(
        message.header, robot=camera.robot, camera=camera.camera, seq=seq, stamp_ns=time.time_ns()
    )
    return msgspec.structs.replace(message, header=about)


class MaskFlood:
    """A distance worker, and what it did. sent: frames with huge masks."""

    def __init__(self, bus: Bus, process: Process) -> None:
        self._bus, self._process = bus, process
        self._answers: dict[int, asyncio.Event] = {}
        self._seq = itertools.count(1)
        self.sent = self.sent_bytes = 0

    async def run(self, seconds: float) -> dict[str, Any]:
        """Flood for so long; return the figures."""
        async with (
            robot(self._bus, GOOD) as good,
            self._bus.subscribe(GOOD.stream(Stream.DISTANCES), QUEUE(100)) as answers,
            self._bus.subscribe(BAD.stream(Stream.DISTANCES), QUEUE(100)),
            asyncio.TaskGroup() as group,
        ):
            hearing = group.create_task(self._hear(answers))
            good.send(Stream.INFO, info(height=scenes.HEIGHT, width=scenes.WIDTH, focal=scenes.FOCAL))
            async with asyncio.timeout(START_S):
                while await self._time(good, within_s=1.0) >= 1.0:
                    pass
            alone_s = max([await self._time(good) for _ in range(5)])
            before = highest = self._process.rss_bytes()
            async with robot(self._bus, BAD) as bad:
                flooding = group.create_task(self._flood(bad, seconds))
                longest_s = 0.0
                while not flooding.done():
                    longest_s = max(longest_s, await self._time(good))
                    highest = max(highest, self._process.rss_bytes())
                for _ in range(5):
                    longest_s = max(longest_s, await self._time(good))
                    highest = max(highest, self._process.rss_bytes())
            hearing.cancel()
        return {
            "masks_sent": self.sent * MASKS,
            "masks_sent_mb": round(self.sent_bytes / 2**20, 1),
            "masks_rss_growth_mb": round((highest - before) / 2**20, 1),
            "masks_answers_s": round(longest_s, 2),
            "masks_answers_alone_s": round(alone_s, 2),
        }

    async def _flood(self, bad: Robot, seconds: float) -> None:
        seen, depth = huge_frame()
        bad.send(Stream.INFO, info(height=SIDE, width=SIDE, focal=float(SIDE)))
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            seq = next(self._seq)
            for stream, message in ((Stream.DEPTH, depth), (Stream.DETECTIONS, seen)):
                payload = codec.encode(self._same(message, BAD, seq))
                bad.send(stream, payload)
                self.sent_bytes += len(payload)
            self.sent += 1
            await asyncio.sleep(PERIOD_S)

    def _same(self, message: Any, camera: CameraKey, seq: int) -> Any:
        """Return a message of a frame; all messages of one have the same time."""
        made = named(message, camera, seq)
        about = msgspec.structs.replace(made.header, stamp_ns=scenes.stamp_of(seq))
        return msgspec.structs.replace(made, header=about)

    async def _time(self, good: Robot, within_s: float = LOST_S) -> float:
        """Send a frame; return how long it takes until its object is measured."""
        if not self._process.runs():
            raise PeerError(self._process.last_words())
        seen, depth = small_frame()
        seq = next(self._seq)
        answered = self._answers[seq] = asyncio.Event()
        began_s = time.monotonic()
        for stream, message in ((Stream.DEPTH, depth), (Stream.DETECTIONS, seen)):
            good.send(stream, self._same(message, GOOD, seq))
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                await answered.wait()
        del self._answers[seq]
        took_s = time.monotonic() - began_s
        await asyncio.sleep(max(0.0, PERIOD_S - took_s))
        return took_s

    async def _hear(self, answers: Subscription) -> None:
        async for sample in answers:
            distances = codec.decode(Distances, sample.payload, sample.encoding)
            if (answered := self._answers.get(distances.header.seq)) is not None and distances.objects[0].measured:
                answered.set()


async def flood_of_masks(seconds: float) -> dict[str, Any]:
    """Start a distance worker, have a robot send it huge masks for so long, and return the figures.

    Raises:
        PeerError: the worker ended.
    """
    endpoint = free_endpoint()
    async with open_bus(BusSettings(mode="router", listen=[endpoint], shared_memory=False)) as bus:
        present = [bus.announce(keys.robot_alive(each.robot)) for each in (GOOD, BAD)]
        async with present[0], present[1]:
            with running([*TOOLBOX, "distance", "--connect", endpoint, "--no-shared-memory"]) as process:
                return await MaskFlood(bus, process).run(seconds)
