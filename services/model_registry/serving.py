"""Serves the model registry on the bus: its state, pieces of files, and what operators ask of it."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Final, TypeVar

from bus import Bus, Handler, QoS, RefusedError, Reply, Request
from schemas import codec
from schemas.errors import SchemaError
from schemas.models import ModelPieceRequest, ModelRegistry, ModelUpload, ModelUploadAnswer, ModelUse
from schemas.worker_keys import ModelKey
from services.model_registry.registry import Registry, RegistryError
from services.worker.thread import worker_thread

log = logging.getLogger(__name__)

AGAIN_S: Final = 5.0
"""Seconds between two messages with an unchanged state."""

WAITING: Final = 16
PIECES_WAITING: Final = 1_000
"""Requests for pieces that wait, two of each worker: hundreds may fetch a model at once; others ask again."""

T = TypeVar("T")
Q = TypeVar("Q", bound=codec.Message)


@asynccontextmanager
async def serving_models(bus: Bus, folder: Path) -> AsyncIterator[None]:
    """Serve the registry in a folder while the context lasts.

    Raises:
        RegistryError: the folder cannot be used.
    """
    async with AsyncExitStack() as stack:
        thread = stack.enter_context(worker_thread("models"))
        loop = asyncio.get_running_loop()
        registry = await loop.run_in_executor(thread, Registry, folder)
        qos, encoding = QoS.STATUS, codec.encoding(ModelRegistry)
        publisher = await stack.enter_async_context(bus.publisher(ModelKey.REGISTRY, qos, encoding=encoding))

        def tell() -> Reply:
            state = codec.encode(registry.state)
            publisher.put(state)
            return Reply(state, encoding)

        async def answered(call: Callable[[], T]) -> T:
            try:
                return await loop.run_in_executor(thread, call)
            except RegistryError as error:
                raise RefusedError(str(error)) from error

        async def listed(_: Request) -> Reply:
            return Reply(codec.encode(registry.state), encoding)

        async def piece(request: Request) -> Reply:
            asked = _decoded(ModelPieceRequest, request)
            found = await answered(lambda: registry.piece(asked))
            return Reply(codec.encode(found), codec.encoding(type(found)))

        async def publish(request: Request) -> Reply:
            upload, before = _decoded(ModelUpload, request), registry.state
            missing = await answered(lambda: registry.take(upload, time.monotonic()))
            if registry.state is not before:
                tell()
            return Reply(codec.encode(ModelUploadAnswer(missing=missing)), codec.encoding(ModelUploadAnswer))

        async def use(request: Request) -> Reply:
            asked = _decoded(ModelUse, request)
            await answered(lambda: registry.use(asked))
            _log(registry.state)
            return tell()

        handlers: dict[ModelKey, Handler] = {
            ModelKey.LIST: listed,
            ModelKey.PIECE: piece,
            ModelKey.PUBLISH: publish,
            ModelKey.USE: use,
        }
        for key, handler in handlers.items():
            waiting = PIECES_WAITING if key is ModelKey.PIECE else WAITING
            await stack.enter_async_context(bus.serve(key, handler, waiting=waiting))
        async with asyncio.TaskGroup() as group:
            repeating = group.create_task(_repeat(tell))
            try:
                yield
            finally:
                repeating.cancel()


async def _repeat(tell: Callable[[], Reply]) -> None:
    while True:
        tell()
        await asyncio.sleep(AGAIN_S)


def _decoded(schema: type[Q], request: Request) -> Q:
    try:
        return codec.decode(schema, request.payload, request.encoding)
    except SchemaError as error:
        raise RefusedError(str(error)) from error


def _log(state: ModelRegistry) -> None:
    in_force, canary = state.find(state.in_force), state.find(state.canary)
    beside = f", and {canary.label} for {', '.join(state.robots)}" if canary is not None else ""
    log.info("in force is %s%s", "no model" if in_force is None else in_force.label, beside)
