"""Objects followed from frame to frame of each camera."""

import asyncio
import logging
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Final, Protocol

import msgspec

from schemas.detections import TRACK_COUNT_BITS, Detection
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from schemas.status import MAX_STREAMS
from services.detector.model import DetectedObjects, Request

log = logging.getLogger(__name__)

GAP_NS: Final = 5_000_000_000
"""Longest time between two frames of a camera after which what moves is still known."""

EPOCH_BITS: Final = 32
"""Each tracker's numbers begin with so many random bits: other workers' and later ones never meet them."""


class Tracker(Protocol):
    """Follows the objects of one camera."""

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        """Take the next frame's objects; return each one's number, from 1, or None while it is unconfirmed."""


class CameraTracks:
    """Tracks of one camera; a new tracker starts whenever frames no longer continue the old ones."""

    def __init__(self, make: Callable[[], Tracker]) -> None:
        self._make = make
        self._tracker = make()
        self._last: Header | None = None
        self._model = ""
        self._epoch = secrets.randbits(EPOCH_BITS)

    def follow(self, objects: list[Detection], frame: ImageFrame, model: str = "") -> list[Detection]:
        """Return the objects with their track numbers. model: the one that found them; each numbers its own classes."""
        if self._last is not None and not (model == self._model and _goes_on(self._last, frame.header)):
            self._begin()
        self._last, self._model = frame.header, model
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


class Tracking:
    """Follows the objects of any number of cameras, on its own thread.

    max_cameras: whose objects are remembered; those of the camera seen longest ago are forgotten first.
    """

    def __init__(self, make: Callable[[], Tracker], max_cameras: int = MAX_STREAMS) -> None:
        self._make = make
        self._max_cameras = max_cameras
        self._cameras: OrderedDict[CameraKey, CameraTracks] = OrderedDict()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="tracks")

    def close(self) -> None:
        """Stop, without waiting for frames in progress."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def follow(self, request: Request, found: DetectedObjects) -> DetectedObjects:
        """Return the detections with their track numbers. Frames are processed in the order of the calls.

        What cannot be followed has none, and its camera begins anew.
        """
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._followed, request, found)

    def _followed(self, request: Request, found: DetectedObjects) -> DetectedObjects:
        began_ns = time.perf_counter_ns()
        try:
            objects = self._tracks(request.camera).follow(found.objects, request.frame, found.model)
        except Exception:  # whatever is wrong with an image, it fails alone
            log.exception("%s: objects of frame %d are not followed", request.camera, request.frame.header.seq)
            self._cameras.pop(request.camera, None)
            return found
        spans = {**found.spans, "track": time.perf_counter_ns() - began_ns}
        return replace(found, objects=objects, spans=spans)

    def _tracks(self, camera: CameraKey) -> CameraTracks:
        tracks = self._cameras.get(camera) or CameraTracks(self._make)
        self._cameras[camera] = tracks
        self._cameras.move_to_end(camera)
        if len(self._cameras) > self._max_cameras:
            self._cameras.popitem(last=False)
        return tracks
