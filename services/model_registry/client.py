"""Asks the model registry over the bus: what is published, what is to be in force; sends it a file in pieces."""

import asyncio
import random
from collections.abc import Callable, Coroutine, Iterable
from pathlib import Path
from typing import Final, TypeVar

from bus import Bus, RefusedError, RequestError
from schemas import codec
from schemas.models import (
    PIECE_BYTES,
    ModelRegistry,
    ModelUpload,
    ModelUploadAnswer,
    ModelUse,
    PublishedModel,
    piece_bytes,
    pieces_of,
)
from schemas.worker_keys import ModelKey

AT_ONCE: Final = 2
"""Pieces in flight: more would queue behind the fleet's own messages."""

PIECE_S: Final = 20.0
LAST_PIECE_S: Final = 60.0
"""Seconds that an answer may take; after the last piece of a file the registry reads all of it."""

TRIES: Final = 5
"""How often a piece without an answer is sent, before the whole fails."""

AGAIN_S: Final = (0.5, 2.5)
"""How long a piece without an answer waits, by lot."""

BUSY: Final = "busy:"

Progress = Callable[[int], None]
"""Is told the number of bytes that are there, after each piece."""

A = TypeVar("A", bound=codec.Message)


async def ask_registry(bus: Bus, timeout_s: float) -> ModelRegistry:
    """Return the registry's state.

    Raises:
        RequestError: no registry answers.
        SchemaError: the answer cannot be read.
    """
    reply = await bus.request(ModelKey.LIST, timeout_s=timeout_s)
    return codec.decode(ModelRegistry, reply.payload, reply.encoding)


async def use_model(bus: Bus, asked: ModelUse, timeout_s: float) -> ModelRegistry:
    """Have the registry put a model in force, or go back; return its changed state. Raises as `ask_registry` does."""
    return await _once(bus, ModelKey.USE, asked, ModelRegistry, timeout_s)


async def publish_model(bus: Bus, model: PublishedModel, file: Path, progress: Progress) -> None:
    """Send a file to the registry, piece by piece, until it is published.

    Raises:
        RequestError: the registry does not answer, or refuses it.
        SchemaError: an answer cannot be read.
        OSError: the file cannot be read.
    """
    lacking = set(range(pieces_of(model.size)))
    with await asyncio.to_thread(file.open, "rb") as content:

        async def send(index: int) -> None:
            content.seek(index * PIECE_BYTES)
            piece = ModelUpload(model=model, index=index, data=memoryview(content.read(PIECE_BYTES)))
            timeout_s = LAST_PIECE_S if len(lacking) <= AT_ONCE else PIECE_S
            answer = await _asked(bus, ModelKey.PUBLISH, piece, ModelUploadAnswer, timeout_s)
            lacking.intersection_update(answer.missing)
            progress(model.size - sum(piece_bytes(model.size, each) for each in lacking))

        for _ in range(TRIES):
            await _in_flight(sorted(lacking), send)
            answer = await _missing(bus, model)
            if not answer:
                return
            lacking.update(answer)
    raise RequestError(f"{model.name} does not arrive whole: was the monitor started again meanwhile? Try again")


async def _missing(bus: Bus, model: PublishedModel) -> set[int]:
    """Return the pieces to send again: all where the registry, restarted meanwhile, does not know the model."""
    state = await ask_registry(bus, PIECE_S)
    return set() if state.find(model.digest) is not None else set(range(pieces_of(model.size)))


async def _in_flight(indices: Iterable[int], transfer: Callable[[int], Coroutine[None, None, None]]) -> None:
    """Transfer pieces in turn, AT_ONCE at a time. Raises the first error of one."""
    left = iter(indices)

    async def transfer_next() -> None:
        for index in left:
            await transfer(index)

    try:
        async with asyncio.TaskGroup() as group:
            for _ in range(AT_ONCE):
                group.create_task(transfer_next())
    except ExceptionGroup as failed:
        raise failed.exceptions[0] from failed


async def _asked(bus: Bus, key: ModelKey, question: codec.Message, answer: type[A], timeout_s: float) -> A:
    """Ask; again after a while where nobody answers, as while a link is cut, or the registry is busy."""
    for _ in range(TRIES - 1):
        try:
            return await _once(bus, key, question, answer, timeout_s)
        except RefusedError as error:
            if BUSY not in str(error):
                raise
        except RequestError:
            pass
        await asyncio.sleep(random.uniform(*AGAIN_S))  # noqa: S311 - no secret
    return await _once(bus, key, question, answer, timeout_s)


async def _once(bus: Bus, key: ModelKey, question: codec.Message, answer: type[A], timeout_s: float) -> A:
    encoding = codec.encoding(type(question))
    reply = await bus.request(key, codec.encode(question), encoding=encoding, timeout_s=timeout_s)
    return codec.decode(answer, reply.payload, reply.encoding)
