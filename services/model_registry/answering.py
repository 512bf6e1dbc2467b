"""Answers requests to a model registry on the bus, and publishes its state."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final, TypeVar

from bus import Bus, Handler, QoS, RefusedError, Reply, Request
from schemas import codec
from schemas.errors import SchemaError
from schemas.models import ModelPieceRequest, ModelRegistry, ModelUpload, ModelUploadAnswer, ModelUse
from schemas.worker_keys import ModelKey
from services.model_registry.folder import RegistryError
from services.model_registry.registry import Registry

log = logging.getLogger(__name__)

WAITING: Final = 16
PIECES_WAITING: Final = 1_000
"""Requests for pieces that wait, one of each worker: hundreds may fetch a model at once; others ask again."""

T = TypeVar("T")
Q = TypeVar("Q", bound=codec.Message)

ENCODING: Final = codec.encoding(ModelRegistry)


@asynccontextmanager
async def answering(
    bus: Bus, registry: Registry, thread: Executor, stated: Callable[[], ModelRegistry]
) -> AsyncIterator[Callable[[], object]]:
    """Answer requests while the context lasts; give a function that publishes the registry's state.

    thread: runs what the registry does. stated: returns its state as it is told.
    """
    loop = asyncio.get_running_loop()

    async def answered(call: Callable[[], T]) -> T:
        try:
            return await loop.run_in_executor(thread, call)
        except RegistryError as error:
            raise RefusedError(str(error)) from error

    async def listed(_: Request) -> Reply:
        return Reply(codec.encode(stated()), ENCODING)

    async def piece(request: Request) -> Reply:
        asked = _decoded(ModelPieceRequest, request)
        found = await answered(lambda: registry.piece(asked))
        return Reply(codec.encode(found), codec.encoding(type(found)))

    async with AsyncExitStack() as stack:
        publisher = await stack.enter_async_context(bus.publisher(ModelKey.REGISTRY, QoS.STATUS, encoding=ENCODING))

        def tell() -> Reply:
            state = codec.encode(stated())
            publisher.put(state)
            return Reply(state, ENCODING)

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
        yield tell


def _decoded(schema: type[Q], request: Request) -> Q:
    try:
        return codec.decode(schema, request.payload, request.encoding)
    except SchemaError as error:
        raise RefusedError(str(error)) from error


def _log(state: ModelRegistry) -> None:
    in_force, canary = state.find(state.in_force), state.find(state.canary)
    beside = f", and {canary.label} for {', '.join(state.robots)}" if canary is not None else ""
    log.info("in force is %s%s", "no model" if in_force is None else in_force.label, beside)
