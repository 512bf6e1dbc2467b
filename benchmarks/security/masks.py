"""A flood of masks at a distance worker of its own: how much memory it takes, and how long another robot waits."""

import asyncio
import itertools
import time
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
    """Return a message as that of a camera's frame; all messages of one frame have the same time."""
    about = msgspec.structs.replace(
        message.header, robot=camera.robot, camera=camera.camera, seq=seq, stamp_ns=scenes.stamp_of(seq)
    )
    return msgspec.structs.replace(message, header=about)


class GoodRobot:
    """A robot that sends a small frame every PERIOD_S.

    longest_s: that a frame waited until it, or a newer one, was measured: of frames that wait, the newest counts.
    """

    def __init__(self, streams: Robot) -> None:
        self.longest_s = 0.0
        self.measured = 0
        self._streams = streams
        self._waiting: dict[int, float] = {}

    async def send(self) -> None:
        """Send until cancelled."""
        self._streams.send(Stream.INFO, info(height=scenes.HEIGHT, width=scenes.WIDTH, focal=scenes.FOCAL))
        for seq in itertools.count():
            self._waiting[seq] = time.monotonic()
            for stream, message in zip((Stream.DETECTIONS, Stream.DEPTH), small_frame(), strict=True):
                self._streams.send(stream, named(message, GOOD, seq))
            self.look()
            await asyncio.sleep(PERIOD_S)

    async def hear(self, answers: Subscription) -> None:
        """Take what was measured until cancelled."""
        async for sample in answers:
            distances = codec.decode(Distances, sample.payload, sample.encoding)
            if distances.objects[0].measured:
                self.look()
                self.measured += 1
                self._waiting = {seq: at for seq, at in self._waiting.items() if seq > distances.header.seq}

    def look(self) -> None:
        """Note for how long the oldest frame waits."""
        if self._waiting:
            self.longest_s = max(self.longest_s, time.monotonic() - min(self._waiting.values()))

    async def until_measured(self, frames: int) -> None:
        """Wait until so many more frames were measured; then begin to look for the longest wait."""
        least = self.measured + frames
        async with asyncio.timeout(START_S):
            while self.measured < least:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(PERIOD_S)


class MaskFlood:
    """A distance worker under a flood. sent: frames with huge masks, and their bytes."""

    def __init__(self, bus: Bus, process: Process) -> None:
        self._bus, self._process = bus, process
        self._seen, self._depth = huge_frame()  # takes half a second, in which no answer would be heard
        self.sent = self.sent_bytes = 0

    async def run(self, seconds: float) -> dict[str, Any]:
        """Flood for so long; return the figures.

        masks_unscheduled_s: of the worker's thread that waited for a processor longest, for how long it did.
        """
        async with (
            robot(self._bus, GOOD) as streams,
            self._bus.subscribe(GOOD.stream(Stream.DISTANCES), QUEUE(100)) as answers,
            self._bus.subscribe(BAD.stream(Stream.DISTANCES), QUEUE(100)),
            asyncio.TaskGroup() as group,
        ):
            good = GoodRobot(streams)
            tasks = [group.create_task(each) for each in (good.hear(answers), good.send())]
            await good.until_measured(1)
            good.longest_s = 0.0
            await good.until_measured(10)
            alone_s, good.longest_s = good.longest_s, 0.0
            before = highest = self._process.rss_bytes()
            waited_before = self._process.unscheduled_s()
            async with robot(self._bus, BAD) as bad:
                flooding = group.create_task(self._flood(bad, seconds))
                while not flooding.done():
                    highest = max(highest, self._process.rss_bytes())
                    if not self._process.runs():
                        raise PeerError(self._process.last_words())
                    await asyncio.sleep(PERIOD_S)
                await good.until_measured(5)
                highest = max(highest, self._process.rss_bytes())
            waited_s = [
                waited - waited_before.get(thread, 0.0) for thread, waited in self._process.unscheduled_s().items()
            ]
            for task in tasks:
                task.cancel()
        return {
            "masks_sent": self.sent * MASKS,
            "masks_sent_mb": round(self.sent_bytes / 2**20, 1),
            "masks_rss_growth_mb": round((highest - before) / 2**20, 1),
            "masks_answers_s": round(good.longest_s, 2),
            "masks_answers_alone_s": round(alone_s, 2),
            "masks_unscheduled_s": round(max(waited_s), 2),
        }

    async def _flood(self, bad: Robot, seconds: float) -> None:
        bad.send(Stream.INFO, info(height=SIDE, width=SIDE, focal=float(SIDE)))
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            for stream, message in ((Stream.DEPTH, self._depth), (Stream.DETECTIONS, self._seen)):
                payload = codec.encode(named(message, BAD, self.sent))
                bad.send(stream, payload)
                self.sent_bytes += len(payload)
            self.sent += 1
            await asyncio.sleep(PERIOD_S)


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
