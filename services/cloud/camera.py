"""Receives one camera's detections and points while object clouds are wanted, and publishes the clouds."""

import asyncio
import logging
from asyncio import TaskGroup
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from time import perf_counter_ns
from typing import Any, Final, TypeVar

import msgspec

from bus import LATEST, QUEUE, Bus, Sample, Subscription
from bus.clocks import clock_id
from bus.sharing.work_counts import Tally
from schemas import codec
from schemas.camera_info import CameraInfo
from schemas.codec import Message
from schemas.consumer_keys import Wanted, new_consumer
from schemas.detections import Detections
from schemas.errors import SchemaError
from schemas.keys import TF, TF_STATIC, CameraKey, RobotStreamKey, Stream, StreamKey
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from schemas.status import UNWANTED
from schemas.transforms import Transforms
from services.cloud.cutting import Job, cut, nothing
from services.cloud.measuring import CloudLimits
from services.cloud.waiting import (
    FAILED,
    MALFORMED,
    MALFORMED_INFO,
    MALFORMED_POINTS,
    MALFORMED_TRANSFORMS,
    REPLACED,
    TOO_MANY_POINTS,
    TOO_MANY_TRANSFORMS,
    UNJOINED,
    UNPLACED,
    CloudJoiner,
    Matched,
)
from services.geometry.memory_budget import MemoryBudget

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)

POINTS_WAITING: Final = QUEUE(8, 128 << 20)
TRANSFORMS_WAITING: Final = QUEUE(1_000, 16 << 20)
"""Messages that wait to be taken at most."""

WAITED: Final = "join"
CUT: Final = "cloud"

_LOST: Final[dict[type[Any], str]] = {
    Detections: REPLACED,
    PointCloud: TOO_MANY_POINTS,
    Transforms: TOO_MANY_TRANSFORMS,
}
"""Reason for messages beyond that; of calibrations only the newest matters."""


class CloudCamera:
    """Cuts one camera's objects out of points. executor: runs the cutting, off the event loop."""

    def __init__(
        self,
        bus: Bus,
        key: CameraKey,
        tally: Tally,
        *,
        worker: str,
        executor: Executor,
        limits: CloudLimits,
        target_frame: str,
        tolerance_ns: int | None,
        budget: MemoryBudget,
    ) -> None:
        self._bus = bus
        self._key = key
        self._tally = tally
        self._worker = worker
        self._executor = executor
        self._limits = limits
        self._target_frame = target_frame
        self._waiting = CloudJoiner(tally, target=target_frame, tolerance_ns=tolerance_ns, budget=budget)
        self._news = asyncio.Event()

    async def run(self, points: CameraKey, publish: Callable[[ObjectClouds], None]) -> None:
        """Work with the points of this sensor until cancelled."""
        tf, tf_static = (RobotStreamKey(self._key.robot, stream) for stream in (TF, TF_STATIC))
        wants_points = Wanted(StreamKey(points, Stream.POINTS), clock_id(), self._worker)
        bus, waiting = self._bus, self._waiting
        wants_tf = Wanted(tf, clock_id(), new_consumer(bus.certificate))  # other cameras here want them too
        try:
            async with (
                bus.announce(str(wants_points)),
                bus.announce(str(wants_tf)),
                bus.subscribe(str(tf_static), TRANSFORMS_WAITING) as static,
                bus.subscribe(str(tf), TRANSFORMS_WAITING, history=False) as moving,
                bus.subscribe(self._key.stream(Stream.INFO), LATEST) as infos,
                bus.subscribe(points.stream(Stream.POINTS), POINTS_WAITING, history=False) as clouds,
                bus.subscribe(self._key.stream(Stream.DETECTIONS), LATEST, history=False) as detections,
                TaskGroup() as group,
            ):
                read = self._read
                group.create_task(read(static, Transforms, tf_static, MALFORMED_TRANSFORMS, self._static))
                group.create_task(read(moving, Transforms, tf, MALFORMED_TRANSFORMS, self._moving))
                group.create_task(read(infos, CameraInfo, self._key, MALFORMED_INFO, self._info))
                group.create_task(read(clouds, PointCloud, points, MALFORMED_POINTS, waiting.points))
                group.create_task(read(detections, Detections, self._key, MALFORMED, self._detections))
                await self._work(publish)
        finally:
            self._tally.dropped[UNWANTED] += waiting.end()

    def _static(self, sent: Transforms) -> None:
        self._waiting.transforms(sent, static=True)

    def _moving(self, sent: Transforms) -> None:
        self._waiting.transforms(sent, static=False)

    def _info(self, info: CameraInfo) -> None:
        self._waiting.info = info

    def _detections(self, found: Detections) -> None:
        self._waiting.detections(found, asyncio.get_running_loop().time())

    async def _read(
        self,
        samples: Subscription,
        schema: type[M],
        of: CameraKey | RobotStreamKey,
        malformed: str,
        take: Callable[[M], None],
    ) -> None:
        try:
            async for sample in samples:
                if schema in _LOST:
                    self._tally.dropped[_LOST[schema]] += sample.replaced
                message = self._decoded(sample, schema, of, malformed)
                if message is not None:
                    take(message)
                    self._news.set()
        finally:
            if schema is Detections:
                self._tally.dropped[UNWANTED] += samples.counts.unread

    def _decoded(self, sample: Sample, schema: type[M], of: CameraKey | RobotStreamKey, malformed: str) -> M | None:
        try:
            message = codec.decode(schema, sample.payload, sample.encoding)
            codec.check_identity(message.header, of)  # type: ignore[union-attr]
        except SchemaError as error:
            self._tally.dropped[malformed] += 1
            log.warning("%s: left out: %s", sample.key, error)
            return None
        return message

    async def _work(self, publish: Callable[[ObjectClouds], None]) -> None:
        loop = asyncio.get_running_loop()
        while True:
            matched = self._waiting.take(loop.time())
            if matched is not None:
                await self._answer(matched, publish)
                continue
            self._news.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout_at(self._waiting.until_s):
                    await self._news.wait()

    async def _answer(self, matched: Matched, publish: Callable[[ObjectClouds], None]) -> None:
        try:
            reason = await self._publish_clouds(matched, publish)
        except asyncio.CancelledError:
            self._tally.dropped[UNWANTED] += 1
            raise
        except Exception as error:  # noqa: BLE001 - whatever is wrong with an answer, it fails alone
            log.warning("%s: frame %d failed: %r", self._key, matched.detections.header.seq, error)
            reason = FAILED
            publish(nothing(matched.detections, "it failed", self._worker).clouds)
        if reason:
            self._tally.dropped[reason] += 1
        else:
            self._tally.done += 1

    async def _publish_clouds(self, matched: Matched, publish: Callable[[ObjectClouds], None]) -> str:
        """Return why no object has a cloud, or an empty string."""
        found = matched.detections
        if matched.cloud is None:
            publish(nothing(found, matched.unknown, self._worker).clouds)
            return UNJOINED
        begun_ns = perf_counter_ns()
        job = Job.of(found, matched.cloud, self._waiting, self._target_frame)
        made = await asyncio.get_running_loop().run_in_executor(self._executor, cut, job, self._limits, self._worker)
        spans = {**found.spans, WAITED: round(matched.waited_s * 1e9), CUT: perf_counter_ns() - begun_ns}
        publish(msgspec.structs.replace(made.clouds, spans=spans))
        return UNPLACED if made.unknown else ""
