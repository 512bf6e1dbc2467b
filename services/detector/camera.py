"""Results and frames of one camera at a worker, published and queued while there is demand."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Final

from bus import LATEST, Bus, Publisher, QoS, Sample
from bus.clocks import clock_id
from bus.demand import SharedDemand, while_wanted
from bus.sharing.rate_request import RateRequest
from schemas import codec
from schemas.consumer_keys import Wanted
from schemas.detections import KEPT_LISTS, ClassList, Detections, class_list
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey
from schemas.status import UNWANTED
from services.detector.frame_counts import ABOVE_OPINION_RATE, DEPTH, REPLACED, FrameCounts
from services.detector.frame_queue import FrameQueue, QueuedFrame
from services.detector.overlay_publisher import MASKS, Overlays, drawing
from services.detector.pixels import shows_colours
from services.detector.worker_role import DETECTOR, WorkerRole
from services.worker.rate_limiter import RateLimiter


@dataclass(frozen=True, slots=True)
class CameraOutputs:
    """Publishers of one camera's results, and the demand for them. detections: None if only class lists are made."""

    key: CameraKey
    tally: FrameCounts
    demand: SharedDemand
    detections: Publisher | None
    classes: Publisher
    overlays: Overlays

    @property
    def wants_masks(self) -> bool:
        """Whether masks are wanted."""
        return self._wants_detections or self.overlays.wants_masks

    @property
    def wants_tracks(self) -> bool:
        """Whether track numbers are wanted."""
        return self._wants_detections or self.overlays.wanted

    @property
    def _wants_detections(self) -> bool:
        return self.detections is not None and self.detections.wanted

    def publish_classes(self, found: Detections) -> None:
        """Publish the class list if it is wanted."""
        if self.classes.wanted:
            self.classes.put(codec.encode(class_list(found)))

    def publish_objects(self, found: Detections, frame: ImageFrame) -> None:
        """Publish the results that are wanted; overlays follow once drawn."""
        if self.detections is not None and self.detections.wanted:
            self.detections.put(codec.encode(found))
        self.overlays.offer(found, frame)


@asynccontextmanager
async def serving(
    bus: Bus,
    key: CameraKey,
    tally: FrameCounts,
    *,
    role: WorkerRole = DETECTOR,
    segments: bool = True,
    overlay_threads: Executor | None = None,
) -> AsyncIterator[CameraOutputs]:
    """Declare a camera's result streams while the context lasts.

    role: says which there are. segments: whether there are masks to draw. overlay_threads: see `drawing`.
    """
    demand = SharedDemand()

    def declare(
        stream: Stream, qos: QoS, schema: type[codec.Message], *, kept: int = 1
    ) -> AbstractAsyncContextManager[Publisher]:
        encoding = codec.encoding(schema)
        return bus.publisher(key.stream(stream), qos, encoding=encoding, kept=kept, on_demand=demand.of(stream))

    async with AsyncExitStack() as stack:
        classes = await stack.enter_async_context(declare(role.lists, QoS.RESULT, ClassList, kept=KEPT_LISTS))
        detections = (
            None
            if role.lists_only
            else await stack.enter_async_context(declare(Stream.DETECTIONS, QoS.RESULT, Detections))
        )
        publishers = {
            stream: await stack.enter_async_context(declare(stream, QoS.IMAGE, ImageFrame))
            for stream, masks in MASKS.items()
            if not role.lists_only and (segments or not masks)
        }
        overlays = await stack.enter_async_context(drawing(publishers, overlay_threads))
        yield CameraOutputs(key, tally, demand, detections, classes, overlays)


BUCKET_NS: Final = 2_000_000_000
"""After twice as long a clock that was set is believed."""


class Lateness:
    """Estimates how late a sender's frames are, relative to the quickest recent frame by both clocks."""

    def __init__(self) -> None:
        self._since_ns = 0
        self._quickest_ns: int | None = None
        self._before_ns: int | None = None

    def late_ns(self, sent_ns: int, received_ns: int) -> int:
        """Return the delay of a frame, given its send time by the sender's clock and its arrival time by ours."""
        took_ns = received_ns - sent_ns
        if self._quickest_ns is None:
            self._since_ns, self._quickest_ns = received_ns, took_ns
        elif not 0 <= received_ns - self._since_ns < BUCKET_NS:
            self._since_ns, self._before_ns, self._quickest_ns = received_ns, self._quickest_ns, took_ns
        self._quickest_ns = min(self._quickest_ns, took_ns)
        return took_ns - min(self._quickest_ns, self._quickest_ns if self._before_ns is None else self._before_ns)


log = logging.getLogger(__name__)


async def feed(
    bus: Bus, camera: CameraOutputs, frame_queue: FrameQueue, asked: RateRequest, *, worker: str, role: WorkerRole
) -> None:
    """Put the camera's newest frame on the queue while its results are wanted; runs until cancelled.

    asked: the rate requested from the camera's gateway; an opinion worker skips further frames, which others may have
    requested. worker, role: the name under which the gateway lists this consumer.
    """
    color, consumer = StreamKey(camera.key, Stream.COLOR), role.consumer(worker)

    async def receive() -> None:
        camera.tally.begin()
        lateness, rate_limiter = Lateness(), RateLimiter()

        def passes(arrived_ns: int) -> bool:
            return role.most_hz is None or asked.hz is None or rate_limiter.passes(arrived_ns, asked.hz, asked.from_ns)

        try:
            async with (
                bus.announce(str(Wanted(color, clock_id(), consumer))),
                asyncio.TaskGroup() as group,
                bus.subscribe(str(color), LATEST, history=False) as frames,
            ):
                telling = group.create_task(asked.tell(bus, color, consumer))
                try:
                    async for sample in frames:
                        accept(camera, frame_queue, sample, lateness, passes)
                    telling.cancel()
                finally:
                    camera.tally.dropped[UNWANTED] += frames.counts.unread
        finally:
            camera.tally.dropped[UNWANTED] += frame_queue.discard(camera.key)

    await while_wanted(camera.demand, receive)


def accept(
    camera: CameraOutputs, frame_queue: FrameQueue, sample: Sample, lateness: Lateness, passes: Callable[[int], bool]
) -> None:
    """Put a frame on the queue, or count why it was dropped. passes: whether a frame of this arrival time is used."""
    try:
        frame = codec.decode(ImageFrame, sample.payload, sample.encoding)
        codec.check_identity(frame.header, camera.key)
    except SchemaError as error:
        camera.tally.malformed(sample.replaced)
        log.warning("%s: frame left out: %s", camera.key, error)
        return
    if not camera.tally.arrived(frame.header, sample.replaced):
        return
    if not shows_colours(frame):
        camera.tally.dropped[DEPTH] += 1
        return
    if not passes(sample.received_ns):
        camera.tally.dropped[ABOVE_OPINION_RATE] += 1
        return
    late_ns = lateness.late_ns(frame.header.received_ns, sample.received_ns)
    camera.tally.dropped[REPLACED] += frame_queue.post(camera.key, QueuedFrame(frame, sample.received_ns, late_ns))
