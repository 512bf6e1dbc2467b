"""Objects followed from frame to frame of a camera, by Ultralytics' own trackers."""

import asyncio
import secrets
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Final, Protocol

import msgspec

from schemas.detections import TRACK_COUNT_BITS, Detection
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from schemas.status import MAX_STREAMS
from schemas.tuning import Tuning
from services.detector.model import Found, Model, Outcome, Request

GAP_NS: Final = 5_000_000_000
"""Longest time between two frames of a camera after which what moves is still known."""

EPOCH_BITS: Final = 32
"""Each tracker's numbers begin with so many random bits: other workers' and later ones never meet them."""


class Tracker(Protocol):
    """Follows the objects of one camera."""

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        """Take the next frame's objects; return each one's number, from 1, or None while it is not sure of it."""


class CameraTracks:
    """One camera's objects: a new tracker whenever the old one's frames have nothing to do with the new ones."""

    def __init__(self, make: Callable[[], Tracker]) -> None:
        self._make = make
        self._tracker = make()
        self._last: Header | None = None
        self._epoch = secrets.randbits(EPOCH_BITS)

    def follow(self, objects: list[Detection], frame: ImageFrame) -> list[Detection]:
        """Return the objects with the numbers of their tracks."""
        if self._last is not None and not _goes_on(self._last, frame.header):
            self._begin()
        self._last = frame.header
        numbers = self._tracker.update(objects, frame)
        if any(number is not None and number >> TRACK_COUNT_BITS for number in numbers):
            self._begin()
            numbers = self._tracker.update(objects, frame)
        return [
            each if number is None else msgspec.structs.replace(each, track=self._epoch << TRACK_COUNT_BITS | number)
            for each, number in zip(objects, numbers, strict=True)
        ]

    def _begin(self) -> None:
        self._tracker = self._make()
        self._epoch = secrets.randbits(EPOCH_BITS)


def _goes_on(last: Header, now: Header) -> bool:
    """Whether a frame is a later one of the same source, and not much later."""
    return last.boot_id == now.boot_id and last.seq < now.seq and 0 <= now.received_ns - last.received_ns <= GAP_NS


class TrackingModel:
    """A model whose objects are followed, camera by camera."""

    def __init__(self, model: Model, make: Callable[[], Tracker], max_cameras: int = MAX_STREAMS) -> None:
        self._model = model
        self._make = make
        self._max_cameras = max_cameras
        self._turn = asyncio.Lock()
        self._cameras: OrderedDict[CameraKey, CameraTracks] = OrderedDict()

    @property
    def name(self) -> str:
        """See `Model.name`."""
        return self._model.name

    @property
    def max_batch(self) -> int:
        """See `Model.max_batch`."""
        return self._model.max_batch

    @property
    def in_flight(self) -> int:
        """See `Model.in_flight`."""
        return self._model.in_flight

    @property
    def segments(self) -> bool:
        """See `Model.segments`."""
        return self._model.segments

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `Model.remarks`."""
        return self._model.remarks

    @property
    def tuning(self) -> Tuning:
        """See `Model.tuning`."""
        return self._model.tuning

    def tune(self, tuning: Tuning) -> None:
        """See `Model.tune`."""
        self._model.tune(tuning)

    def close(self) -> None:
        """See `Model.close`."""
        self._model.close()

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        outcomes = await self._model.infer(batch)
        async with self._turn:  # it lets those who wait through in the order in which they came
            return await asyncio.to_thread(self._all_followed, batch, outcomes)

    def _all_followed(self, batch: Sequence[Request], outcomes: Sequence[Outcome]) -> Sequence[Outcome]:
        return [self._followed(*each) for each in zip(batch, outcomes, strict=True)]

    def _followed(self, request: Request, outcome: Outcome) -> Outcome:
        if not isinstance(outcome, Found):
            return outcome
        tracks = self._cameras.get(request.camera) or CameraTracks(self._make)
        self._cameras[request.camera] = tracks
        self._cameras.move_to_end(request.camera)
        if len(self._cameras) > self._max_cameras:
            self._cameras.popitem(last=False)
        return Found(tracks.follow(outcome.objects, request.frame), outcome.spans)
