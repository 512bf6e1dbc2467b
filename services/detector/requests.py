"""Answers requests to a worker: detections in still images, and its tuning."""

import asyncio
import logging
from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import Final

from bus import Bus, RefusedError, Reply
from bus import Request as Asked
from schemas import codec, worker_keys
from schemas.detections import Detections
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from services.detector import tuning
from services.detector.model import Failed, Model, ModelError, Outcome, Request, end_if_hung
from services.detector.stills import ROBOT, StillError, frame_of
from services.detector.worker_role import DETECTOR, WorkerRole
from services.worker.thread import worker_thread

FINISH_S: Final = 1.2
"""Seconds that work in progress may take at shutdown: less than a supervisor waits before it kills."""


class Leaving:
    """Tells whether a worker is shutting down. until_s: deadline by the loop's clock; None while it works."""

    def __init__(self) -> None:
        self.until_s: float | None = None

    def begin(self) -> None:
        """Begin to shut down: accept nothing more."""
        if self.until_s is None:
            self.until_s = asyncio.get_running_loop().time() + FINISH_S


log = logging.getLogger(__name__)

WAITING: Final = 2
"""Maximum number of queued images; further callers are told that this worker is busy, and ask another."""

STILL: Final = CameraKey(ROBOT, "image")


@asynccontextmanager
async def answering(
    bus: Bus,
    model: Model,
    worker: str,
    role: WorkerRole = DETECTOR,
    leaving: Leaving | None = None,
    *,
    accept_settings: bool = False,
) -> AsyncIterator[None]:
    """Answer requests while the context lasts. role: whether images are answered, too.

    leaving: once the worker leaves, no image is taken in, and the end waits for one that was, as long as it may.
    accept_settings: whether requests may change the model's settings.

    Raises:
        ModelError: an image has shown that the model is of no more use, or it does not answer any more. In a group.
    """
    async with asyncio.TaskGroup() as group, AsyncExitStack() as stack:
        thread = stack.enter_context(worker_thread("stills"))
        stills = Stills(model, worker, thread, leaving or Leaving(), group)
        stack.callback(stills.close)
        if not role.lists_only:
            watching = group.create_task(end_if_hung(lambda: model.name, lambda: stills.asking))
            stack.callback(watching.cancel)
            await stack.enter_async_context(bus.serve(worker_keys.infer(worker), stills.answer, waiting=WAITING))
            stack.push_async_callback(stills.finish)

        async def tune(asked: Asked) -> Reply:
            return tuning.answer(model, asked, accept=accept_settings)

        await stack.enter_async_context(bus.serve(worker_keys.worker_settings(role.service, worker), tune))
        yield


class Stills:
    """Answers requests about image files, decoded one at a time; see `answering`.

    group: what the model does for it, which ends the group where the model is of no more use. asking: the call that it
    has not answered yet.
    """

    def __init__(self, model: Model, worker: str, thread: Executor, leaving: Leaving, group: asyncio.TaskGroup) -> None:
        self._model = model
        self._worker = worker
        self._thread = thread
        self._leaving = leaving
        self._group = group
        self.asking: asyncio.Task[Outcome] | None = None
        self._decoding: asyncio.Future[ImageFrame] | None = None
        self._idle = asyncio.Event()
        self._idle.set()

    async def answer(self, asked: Asked) -> Reply:
        """Return the objects in an image file of any supported format. Called for one file at a time.

        Raises:
            RefusedError: it is no image, failed in the model, or another worker is to be asked.
        """
        if self._leaving.until_s is not None:
            raise RefusedError("busy: this worker is shutting down")
        if self.asking is not None:
            raise RefusedError("busy: still processing an image whose caller has given up")
        self._idle.clear()
        try:
            frame = await self._decoded(asked.payload)
            found = _told(await self._looked_at(frame), frame, self._model, self._worker)
        finally:
            self._idle.set()
        return Reply(codec.encode(found), codec.encoding(Detections))

    async def finish(self) -> None:
        """Wait for the image in progress until the worker's shutdown deadline."""
        if self._leaving.until_s is not None:
            with suppress(TimeoutError):
                async with asyncio.timeout_at(self._leaving.until_s):
                    await self._idle.wait()

    def close(self) -> None:
        """Cancel everything in progress."""
        if self._decoding is not None:
            self._decoding.cancel()
        if self.asking is not None:
            self.asking.cancel()

    async def _decoded(self, image: bytes) -> ImageFrame:
        """Decode in the thread, which continues even if the caller gives up."""
        if self._decoding is not None:
            raise RefusedError("busy: still decoding an image whose caller has given up")
        self._decoding = asyncio.wrap_future(self._thread.submit(frame_of, image))
        self._decoding.add_done_callback(self._forget)
        try:
            return await asyncio.shield(self._decoding)
        except StillError as error:
            raise RefusedError(str(error)) from error

    def _forget(self, _: "asyncio.Future[ImageFrame]") -> None:
        self._decoding = None

    async def _looked_at(self, frame: ImageFrame) -> Outcome:
        """Run the model, which continues even if the caller gives up."""
        self.asking = self._group.create_task(_look(self._model, frame))
        self.asking.add_done_callback(self._answered)
        try:
            return await asyncio.shield(self.asking)
        except ModelError as error:
            self._leaving.begin()  # so that the shutdown waits until the caller has its answer
            raise RefusedError(f"busy: this worker is shutting down: {error}") from error

    def _answered(self, _: "asyncio.Task[Outcome]") -> None:
        self.asking = None


async def detect(model: Model, worker: str, frame: ImageFrame) -> Detections:
    """Return the objects in a still image, with masks.

    Raises:
        RefusedError: it failed in the model.
        ModelError: the model is of no more use.
    """
    return _told(await _look(model, frame), frame, model, worker)


async def _look(model: Model, frame: ImageFrame) -> Outcome:
    (outcome,) = await model.infer([Request(STILL, frame, masks=True)])
    return outcome


def _told(outcome: Outcome, frame: ImageFrame, model: Model, worker: str) -> Detections:
    if isinstance(outcome, Failed):
        raise RefusedError(f"{outcome.reason}: {outcome.error}")
    return outcome.detections(frame, model=model.name, worker=worker)
