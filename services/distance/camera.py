"""Measures one camera's newest detections while distances are wanted."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from bus import LATEST, Bus, Publisher, Sample
from bus.clocks import clock_id
from schemas import codec
from schemas.consumer_keys import Wanted, new_consumer
from schemas.detections import Detections
from schemas.distances import Distances, ObjectDistance
from schemas.errors import SchemaError
from schemas.keys import TF, RobotStreamKey, Stream, StreamKey
from schemas.status import UNWANTED
from services.distance.camera_views import Place, ViewMaker, motion
from services.distance.depth_in_color_view import Views
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView, measure_apart, unknown
from services.distance.sensor_history import ImageContext, SensorHistory
from services.distance.sensor_input import FAILED, REPLACED, UNJOINED, DetectionCounts, SensorInput
from services.geometry.errors import GeometryError, TransformError

log = logging.getLogger(__name__)

WAIT_S: Final = 0.2
"""Seconds that detections wait for the depth image and the transforms of their instant."""

BEFORE_NS: Final = 100_000_000
"""How far back the pose is that says how fast a camera moves."""

WAITED: Final = "join"
MEASURED: Final = "distance"
VIEW: Final = "view"


@dataclass(frozen=True, slots=True, eq=False)
class DistanceCamera:
    """The parts that measure one camera. worker: this worker's name. executor: runs the arithmetic."""

    tally: DetectionCounts
    sensed: SensorHistory
    views: Views
    criteria: Criteria
    worker: str
    executor: Executor
    viewing: "Viewing | None" = None


@dataclass(slots=True, eq=False)
class Viewing:
    """Publishes a camera's views, one in `period_s` at most.

    maker: makes them. frame_id: of their positions. due_s: when the next is due.
    """

    publisher: Publisher
    maker: ViewMaker
    frame_id: str
    period_s: float
    due_s: float = 0.0

    def is_due(self, now_s: float) -> bool:
        """Whether a view is wanted now; the next one is due a period later."""
        if not self.publisher.wanted or now_s < self.due_s:
            return False
        self.due_s = max(self.due_s + self.period_s, now_s + self.period_s / 2)
        return True


async def work(bus: Bus, camera: DistanceCamera, publisher: Publisher, done: Callable[[], None]) -> None:
    """Measure a camera's newest detections until cancelled. done: called after each of them."""
    key = camera.tally.camera
    depth = Wanted(StreamKey(key, Stream.DEPTH), clock_id(), camera.worker)
    consumer = new_consumer(bus.certificate)  # not the worker: other cameras here want them too
    transforms = Wanted(RobotStreamKey(key.robot, TF), clock_id(), consumer)
    sensor_input = SensorInput(camera.tally, camera.sensed)
    try:
        async with (
            bus.announce(str(depth)),
            bus.announce(str(transforms)),
            asyncio.TaskGroup() as group,
            bus.subscribe(key.stream(Stream.DETECTIONS), LATEST, history=False) as samples,
        ):
            group.create_task(sensor_input.run(bus))
            try:
                async for sample in samples:
                    camera.tally.dropped[REPLACED] += sample.replaced
                    await _take(camera, sample, publisher, sensor_input.news)
                    done()
            finally:
                camera.tally.dropped[UNWANTED] += samples.counts.unread
    finally:
        sensor_input.end()


async def _take(camera: DistanceCamera, sample: Sample, publisher: Publisher, news: asyncio.Event) -> None:
    try:
        await _answer(camera, sample, publisher, news)
    except SchemaError as error:
        camera.tally.malformed("detections")
        log.warning("%s: detections left out: %s", camera.tally.camera, error)


async def _answer(camera: DistanceCamera, sample: Sample, publisher: Publisher, news: asyncio.Event) -> None:
    seen = codec.decode(Detections, sample.payload, sample.encoding)
    codec.check_identity(seen.header, camera.tally.camera)
    if not camera.tally.is_new(seen.header):
        return
    try:
        await _measure(camera, seen, sample.received_ns, publisher, news)
    except asyncio.CancelledError:
        camera.tally.dropped[UNWANTED] += 1
        raise
    except Exception as error:  # noqa: BLE001 - whatever is wrong with an answer, it fails alone
        camera.tally.dropped[FAILED] += 1
        log.warning("%s: frame %d failed: %r", camera.tally.camera, seen.header.seq, error)


async def _measure(
    camera: DistanceCamera, seen: Detections, received_ns: int, publisher: Publisher, news: asyncio.Event
) -> None:
    moment = await _moment(camera.sensed, seen, news)
    depth = ImageDepth(camera.views, seen, moment)
    measured = publisher.wanted and await _publish_distances(camera, seen, received_ns, publisher, depth)
    try:
        viewed = await _publish_view(camera, seen, moment, depth)
    except Exception as error:
        if not measured:
            raise
        viewed = False
        camera.tally.add(VIEW, Counter({FAILED: 1}))
        log.warning("%s: the view of frame %d failed: %r", camera.tally.camera, seen.header.seq, error)
    if not measured and not viewed:
        camera.tally.dropped[UNWANTED] += 1
    elif isinstance(moment.instant, str):
        camera.tally.dropped[UNJOINED] += 1
    else:
        camera.tally.done += 1


async def _publish_distances(
    camera: DistanceCamera, seen: Detections, received_ns: int, publisher: Publisher, depth: "ImageDepth"
) -> bool:
    """Measure and publish the distances of an image; return whether they were still wanted then."""
    waited_ns = max(0, time.time_ns() - received_ns)
    loop = asyncio.get_running_loop()
    objects, took_ns = await loop.run_in_executor(camera.executor, _timed, seen, depth, camera.criteria)
    if not publisher.wanted:
        return False
    spans = {**seen.spans, WAITED: waited_ns, MEASURED: took_ns}
    distances = Distances(header=seen.header, objects=objects, model=seen.model, worker=camera.worker, spans=spans)
    publisher.put(codec.encode(distances))
    return True


async def _publish_view(camera: DistanceCamera, seen: Detections, moment: ImageContext, depth: "ImageDepth") -> bool:
    """Make and publish the view of an image if one is due; return whether it was."""
    loop, viewing = asyncio.get_running_loop(), camera.viewing
    if viewing is None or not viewing.is_due(loop.time()):
        return False
    place = _place(camera.sensed, seen, moment, viewing.frame_id)
    view = await loop.run_in_executor(camera.executor, lambda: viewing.maker.view(seen, depth.view, place))
    viewing.publisher.put(codec.encode(view))
    return True


async def _moment(sensed: SensorHistory, seen: Detections, news: asyncio.Event) -> ImageContext:
    """Return the sensor data of an image's instant, once it is complete, or after WAIT_S."""
    with suppress(TimeoutError):
        async with asyncio.timeout(WAIT_S):
            while sensed.at(seen).open:
                news.clear()
                await news.wait()
    return sensed.at(seen)


class ImageDepth:
    """Depth at each pixel of an image, read and registered once, when it is first asked for."""

    def __init__(self, views: Views, seen: Detections, moment: ImageContext) -> None:
        self._views = views
        self._frame_id = seen.header.frame_id
        self._moment = moment

    @cached_property
    def view(self) -> DepthView | str:
        """The depth, or why there is none."""
        if isinstance(self._moment.instant, str):
            return self._moment.instant
        try:
            depth, model = self._views.view(self._moment.instant)
        except GeometryError as error:
            return str(error)
        return DepthView(depth, self._frame_id, model, self._moment.frames)


def _timed(seen: Detections, depth: ImageDepth, criteria: Criteria) -> tuple[list[ObjectDistance], int]:
    begun_ns = time.perf_counter_ns()
    return _objects(seen, depth, criteria), time.perf_counter_ns() - begun_ns


def _objects(seen: Detections, depth: ImageDepth, criteria: Criteria) -> list[ObjectDistance]:
    if not seen.objects:
        return []  # depth need not be read, let alone registered
    if isinstance(depth.view, str):
        return unknown(seen.objects, depth.view)
    try:
        return measure_apart(seen.objects, depth.view, criteria)
    except GeometryError as error:
        return unknown(seen.objects, str(error))


def _place(sensed: SensorHistory, seen: Detections, moment: ImageContext, frame_id: str) -> Place:
    """Return where the camera was, and how fast it moved."""
    frames = {frame.frame_id: frame.from_camera for frame in moment.frames}
    now = frames.get(frame_id, f"{frame_id} is not among the frames that objects are placed in")
    if isinstance(now, str):
        return Place(frame_id, now)
    try:
        before = sensed.transforms.lookup(frame_id, seen.header.frame_id, seen.header.stamp_ns - BEFORE_NS)
    except TransformError:
        return Place(frame_id, now)
    return Place(frame_id, now, *motion(before, now, BEFORE_NS / 1e9))
