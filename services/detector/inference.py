"""Runs queued frames through the model in batches of different cameras, several batches in flight at once.

Lists of classes are published as soon as the model has answered; objects are followed first.
"""

import logging
import time
from asyncio import Event, Queue, Semaphore, Task, TaskGroup
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from bus.sharing.pace import Totals
from schemas.detections import Detections
from schemas.keys import CameraKey
from schemas.status import UNWANTED
from services.detector.camera import CameraOutputs
from services.detector.frame_counts import LATE, STALE, FrameCounts
from services.detector.frame_queue import FrameQueue, QueuedFrame
from services.detector.model import DetectedObjects, Model, Outcome, Request, end_if_hung
from services.detector.regions import Regions
from services.detector.settings import DEADLINE_SLACK_S, LEAST_AGE_S
from services.detector.tracking.tracks import Tracking

BATCH_WAIT_S: Final = 0.005
"""Seconds that a batch waits for more cameras' frames."""

NETWORK_GRACE_S: Final = 2.0
"""Excused link delay while the model keeps up: on a poor link, dropping late frames makes none arrive sooner."""

WEIGHT_OF_NEWEST: Final = 0.1

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class SentFrame:
    """A frame in the model, and its waiting time before. settled: set once the frame is done."""

    camera: CameraOutputs
    queue_ns: int
    request: Request
    settled: Event = field(default_factory=Event)


class Inference:
    """Takes frames from the queue while the model has room, and publishes the results in the same order.

    tracking: follows objects while somebody wants their tracks. cameras: those looked after now. max_age_s: how old a
        frame may be when its turn comes, None for as long as one call takes and DEADLINE_SLACK_S, at least LEAST_AGE_S,
        and as late as NETWORK_GRACE_S beside that while `keeps_up`: the model has time for all frames. regions: of
        cameras' images, that objects are looked for in.
    """

    def __init__(
        self,
        model: Model,
        worker: str,
        frame_queue: FrameQueue,
        *,
        tracking: Tracking | None,
        cameras: dict[CameraKey, CameraOutputs],
        tallies: Mapping[CameraKey, FrameCounts],
        max_age_s: float | None,
        keeps_up: Callable[[], bool],
        on_result: Callable[[CameraKey], None],
        regions: Regions,
    ) -> None:
        self._model = model
        self._regions = regions
        self._worker = worker
        self._frame_queue = frame_queue
        self._tracking = tracking
        self._cameras = cameras
        self._tallies = tallies
        self._max_age_s = max_age_s
        self._keeps_up = keeps_up
        self._on_result = on_result
        self._room = Semaphore(model.in_flight)
        self._under_way: Queue[tuple[Sequence[SentFrame], Task[Sequence[Outcome]]]] = Queue(model.in_flight)
        self._seen: Queue[Sequence[tuple[SentFrame, DetectedObjects | None]]] = Queue(1)
        self._last: dict[CameraKey, Event] = {}
        self._calls = 0
        self._call_s = 0.0
        self._at_work = 0
        self._busy_s = 0.0
        self._busy_since_s = 0.0
        self._done = 0
        self._following = False
        self._followed = 0

    async def run(self) -> None:
        """Run until cancelled.

        Raises:
            ModelError: the model is of no more use, or does not answer any more. In a group.
        """
        try:
            async with TaskGroup() as group:
                group.create_task(self._publish_classes())
                group.create_task(self._publish_objects())
                group.create_task(end_if_hung(self._pending_name, self.pending))
                await self._take(group)
        finally:
            for settled in self._last.values():  # frames in flight will not be published
                settled.set()

    async def settled(self, key: CameraKey) -> None:
        """Wait until the camera's frames in flight are published or dropped."""
        if key in self._last:
            await self._last[key].wait()

    def pending(self) -> object:
        """Return by what the next answer of model or tracker is known, None while none is asked; see `unanswered`."""
        return (self._done, self._followed) if self._calls or self._following else None

    def _pending_name(self) -> str:
        return self._model.name if self._calls else f"the tracker beside {self._model.name}"

    def totals(self) -> Totals:
        """Return the counts of all frames so far."""
        lost = sum(tally.too_many for tally in self._tallies.values())
        running_s = time.monotonic() - self._busy_since_s if self._at_work else 0.0
        return Totals(self._done, lost, self._busy_s + running_s)

    async def _take(self, group: TaskGroup) -> None:
        while True:
            await self._room.acquire()
            while not (batch := await self._batch()):
                pass
            self._last.update((sent.request.camera, sent.settled) for sent in batch)
            call = group.create_task(self._call([sent.request for sent in batch]))
            self._under_way.put_nowait((batch, call))

    async def _batch(self) -> list[SentFrame]:
        wished = sum(camera.demand.wanted for camera in self._cameras.values())
        await self._frame_queue.filled(min(self._model.max_batch, wished), BATCH_WAIT_S)
        now_ns = time.time_ns()
        limit_ns, excused_ns = self._limits_ns()
        for reason, excused in ((STALE, now_ns), (LATE, excused_ns)):  # first those too old by the wait here alone
            for key in self._frame_queue.expire(now_ns, limit_ns, excused):
                self._tallies[key].dropped[reason] += 1
        frames = (
            self._sent_frame(key, waiting, now_ns) for key, waiting in self._frame_queue.take(self._model.max_batch)
        )
        return [frame for frame in frames if frame is not None]

    def _limits_ns(self) -> tuple[int, int]:
        """Return the maximum age of a frame, and the part of its link delay that does not count."""
        if self._max_age_s is not None:
            return round(self._max_age_s * 1e9), 0
        limit_s = max(self._call_s + DEADLINE_SLACK_S, LEAST_AGE_S)
        return round(limit_s * 1e9), round(NETWORK_GRACE_S * 1e9) if self._keeps_up() else 0

    def _sent_frame(self, key: CameraKey, waiting: QueuedFrame, now_ns: int) -> SentFrame | None:
        camera = self._cameras.get(key)
        if camera is None or not camera.demand.wanted:
            self._tallies[key].dropped[UNWANTED] += 1
            return None
        request = Request(key, waiting.frame, camera.wants_masks)
        return SentFrame(camera, max(0, now_ns - waiting.arrived_ns), request)

    async def _call(self, requests: Sequence[Request]) -> Sequence[Outcome]:
        begun_s = time.monotonic()
        self._calls += 1
        try:
            with self._busy():
                return await self._model.infer(requests)
        finally:
            self._calls -= 1
            took_s = time.monotonic() - begun_s
            self._call_s += (took_s - self._call_s) * (WEIGHT_OF_NEWEST if self._call_s else 1)

    @contextmanager
    def _busy(self) -> Iterator[None]:
        """Count the elapsed time as spent on frames, once even when several batches overlap."""
        if not self._at_work:
            self._busy_since_s = time.monotonic()
        self._at_work += 1
        try:
            yield
        finally:
            self._at_work -= 1
            if not self._at_work:
                self._busy_s += time.monotonic() - self._busy_since_s

    async def _publish_classes(self) -> None:
        while True:
            batch, call = await self._under_way.get()
            outcomes = await call
            seen = [(sent, self._counted(sent, outcome)) for sent, outcome in zip(batch, outcomes, strict=True)]
            for sent, found in seen:
                if found is not None:
                    sent.camera.publish_classes(self._detections(sent, found))
            self._room.release()
            with self._busy():  # busy while earlier objects are still being tracked
                await self._seen.put(seen)

    async def _publish_objects(self) -> None:
        while True:
            for sent, found in await self._seen.get():
                if found is not None:
                    await self._publish_found(sent, found)
                sent.settled.set()
                if self._last.get(sent.request.camera) is sent.settled:
                    del self._last[sent.request.camera]

    async def _publish_found(self, sent: SentFrame, found: DetectedObjects) -> None:
        if self._tracking is not None and sent.camera.wants_tracks:
            self._following = True
            try:
                found = await self._tracking.follow(sent.request, found)
            finally:
                self._following = False
                self._followed += 1
        sent.camera.publish_objects(self._detections(sent, found), sent.request.frame)
        self._on_result(sent.camera.key)

    def _counted(self, sent: SentFrame, outcome: Outcome) -> DetectedObjects | None:
        """Count a frame and return its detections."""
        tally, header = sent.camera.tally, sent.request.frame.header
        self._done += 1
        if isinstance(outcome, DetectedObjects):
            tally.done += 1
            return self._regions.within(sent.camera.key, sent.request.frame, outcome)
        tally.dropped[outcome.reason] += 1
        why = f"{sent.camera.key}: {outcome.reason}, {type(outcome.error).__name__}"  # each of these is said once
        log.warning("%s: frame %d of gateway %s left out: %s", why, header.seq, header.boot_id, outcome.error)
        return None

    def _detections(self, sent: SentFrame, found: DetectedObjects) -> Detections:
        return found.detections(sent.request.frame, model=self._model.name, worker=self._worker, queue=sent.queue_ns)
