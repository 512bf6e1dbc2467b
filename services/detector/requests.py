"""What a worker answers when it is asked: what is in an image, and what it counts as a detection."""

import asyncio
import logging
from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final

from bus import Bus, RefusedError, Reply
from bus import Request as Asked
from schemas import codec, worker_keys
from schemas.detections import Detections
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from schemas.tuning import Tuning
from services.detector.model import Failed, Model, ModelError, Request, TuningError
from services.detector.role import DETECTOR, Role
from services.detector.stills import ROBOT, StillError, frame_of
from services.worker_thread import worker_thread

log = logging.getLogger(__name__)

WAITING: Final = 2
"""Images that may wait; whoever asks for one more is told that this worker is busy, and asks another."""

STILL: Final = CameraKey(ROBOT, "image")


@asynccontextmanager
async def answering(bus: Bus, model: Model, worker: str, role: Role = DETECTOR) -> AsyncIterator[None]:
    """Answer requests for as long as the context lasts. role: says whether images are answered, too."""

    async def infer(asked: Asked) -> Reply:
        found = await detect(model, worker, await decoding.frame(asked.payload))
        return Reply(codec.encode(found), codec.encoding(Detections))

    async def tune(asked: Asked) -> Reply:
        return _tune(model, asked)

    async with AsyncExitStack() as stack:
        decoding = Decoding(stack.enter_context(worker_thread("stills")))
        stack.callback(decoding.close)
        if not role.lists_only:
            await stack.enter_async_context(bus.serve(worker_keys.infer(worker), infer, waiting=WAITING))
        await stack.enter_async_context(bus.serve(worker_keys.worker_settings(role.service, worker), tune))
        yield


class Decoding:
    """Decodes one image file at a time in a thread, which goes on when its caller waits no longer."""

    def __init__(self, thread: Executor) -> None:
        self._thread = thread
        self._under_way: asyncio.Future[ImageFrame] | None = None

    async def frame(self, image: bytes) -> ImageFrame:
        """Return an image file of any format as a frame.

        Raises:
            RefusedError: it is no image, or one that nobody waits for any more is still being decoded.
        """
        if self._under_way is not None:
            raise RefusedError("busy: an image is still being decoded whose caller waits no longer")
        self._under_way = asyncio.wrap_future(self._thread.submit(frame_of, image))
        self._under_way.add_done_callback(self._forget)
        try:
            return await asyncio.shield(self._under_way)
        except StillError as error:
            raise RefusedError(str(error)) from error

    def close(self) -> None:
        """Wait for nothing more."""
        if self._under_way is not None:
            self._under_way.cancel()

    def _forget(self, _: "asyncio.Future[ImageFrame]") -> None:
        self._under_way = None


async def detect(model: Model, worker: str, frame: ImageFrame) -> Detections:
    """Return what is in a still image, masks and all.

    Raises:
        RefusedError: it failed in the model.
    """
    try:
        (outcome,) = await model.infer([Request(STILL, frame, masks=True)])
    except ModelError as error:  # the next frame of a camera ends the worker
        raise RefusedError(str(error)) from error
    if isinstance(outcome, Failed):
        raise RefusedError(f"{outcome.reason}: {outcome.error}")
    return outcome.detections(frame, model=model.name, worker=worker)


def _tune(model: Model, asked: Asked) -> Reply:
    """Change the settings that are given, and answer with all of them; without a payload nothing changes."""
    try:
        if asked.payload:
            model.tune(codec.decode(Tuning, asked.payload, asked.encoding))
            log.info("settings changed: %s", model.tuning)
    except (SchemaError, TuningError) as error:
        raise RefusedError(str(error)) from error
    return Reply(codec.encode(model.tuning), codec.encoding(Tuning))
