"""What a worker answers when it is asked: what is in an image, and what it counts as a detection."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final

from bus import Bus, RefusedError, Reply
from bus import Request as Asked
from schemas import codec, worker_keys
from schemas.detections import Detections
from schemas.errors import SchemaError
from schemas.keys import CameraKey
from schemas.tuning import Tuning
from services.detector.model import Failed, Model, ModelError, Request, TuningError
from services.detector.role import DETECTOR, Role
from services.detector.stills import ROBOT, StillError, frame_of

log = logging.getLogger(__name__)

WAITING: Final = 2
"""Images that may wait; whoever asks for one more is told that this worker is busy, and asks another."""

STILL: Final = CameraKey(ROBOT, "image")


@asynccontextmanager
async def answering(bus: Bus, model: Model, worker: str, role: Role = DETECTOR) -> AsyncIterator[None]:
    """Answer requests for as long as the context lasts. role: says whether images are answered, too."""

    async def infer(asked: Asked) -> Reply:
        return await _infer(model, worker, asked)

    async def tune(asked: Asked) -> Reply:
        return _tune(model, asked)

    async with AsyncExitStack() as stack:
        if not role.lists_only:
            await stack.enter_async_context(bus.serve(worker_keys.infer(worker), infer, waiting=WAITING))
        await stack.enter_async_context(bus.serve(worker_keys.worker_settings(role.service, worker), tune))
        yield


async def _infer(model: Model, worker: str, asked: Asked) -> Reply:
    found = await detect(model, worker, asked.payload)
    return Reply(codec.encode(found), codec.encoding(Detections))


async def detect(model: Model, worker: str, image: bytes) -> Detections:
    """Return what is in an image file of any format, masks and all.

    Raises:
        RefusedError: it is no image, or failed in the model.
    """
    try:
        frame = await asyncio.to_thread(frame_of, image)
    except StillError as error:
        raise RefusedError(str(error)) from error
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
