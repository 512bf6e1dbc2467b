"""Ask the fleet: what is in an image, and what the monitor and the world model know."""

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Final

from bus import Bus, NotServedError, RefusedError, RequestError, RequestTimeoutError
from schemas import codec, keys, worker_keys
from schemas.detections import Detections
from schemas.errors import SchemaError
from schemas.inventory import InventoryAnswer, InventoryRequest
from schemas.worker_keys import WorldStream, world_key
from schemas.world import WorldAnswer, WorldRequest

GATHER_S: Final = 0.2
"""How long after the first worker is seen others are waited for."""

BUSY: Final = "busy:"

BUSY_RETRY_S: Final = (0.2, 0.8)
"""How long workers that are all busy are left alone before they are asked again, by lot."""

MIN_TELLING_WAIT_S: Final = 1.0
"""Silence for less time than this says nothing of the worker that was asked."""


async def ask_detectors(
    bus: Bus, image: bytes | bytearray, timeout_s: float, *, until_s: float | None = None
) -> Detections:
    """Ask the detector workers in an order drawn by lot, so that nobody's requests all go to one, until one has time.

    While all are busy they are asked again. until_s: when the time is up on the event loop's clock; `timeout_s` from
    now unless given.

    Zenoh (1.10) would always ask the same of several that serve one key, so each worker serves one of its own.

    Raises:
        RequestError: none answers, or the image is refused.
        SchemaError: the answer cannot be read.
    """
    loop = asyncio.get_running_loop()
    until_s = loop.time() + timeout_s if until_s is None else until_s
    workers = await _workers(bus, until_s)
    reason = _unanswered(bus, timeout_s, seen=bool(workers))
    while workers:
        for worker in random.sample(workers, len(workers)):
            left_s = until_s - loop.time()
            if left_s <= 0:
                raise reason
            try:
                reply = await bus.request(worker_keys.infer(worker), image, timeout_s=left_s)
            except RequestError as error:
                reason = _more_informative(reason, error, worker, left_s)
                if isinstance(error, NotServedError):
                    workers.remove(worker)
                elif BUSY not in str(error):
                    raise reason from error
            else:
                return codec.decode(Detections, reply.payload, reply.encoding)
        await asyncio.sleep(random.uniform(*BUSY_RETRY_S))  # noqa: S311 - no secret
    raise reason


async def ask_inventory(bus: Bus, question: InventoryRequest, timeout_s: float) -> InventoryAnswer:
    """Ask the monitor.

    Raises:
        RequestError: it does not answer.
        SchemaError: the answer cannot be read.
    """
    encoding = codec.encoding(InventoryRequest)
    reply = await bus.request(keys.INVENTORY, codec.encode(question), encoding=encoding, timeout_s=timeout_s)
    return codec.decode(InventoryAnswer, reply.payload, reply.encoding)


async def ask_world(bus: Bus, site: str, question: WorldRequest, timeout_s: float) -> WorldAnswer:
    """Ask the world model of a site.

    Raises:
        RequestError: it does not answer.
        SchemaError: the answer cannot be read.
    """
    encoding = codec.encoding(WorldRequest)
    key = world_key(site, WorldStream.OBJECTS)
    reply = await bus.request(key, codec.encode(question), encoding=encoding, timeout_s=timeout_s)
    return codec.decode(WorldAnswer, reply.payload, reply.encoding)


def _unanswered(bus: Bus, timeout_s: float, *, seen: bool) -> RequestError:
    """Return why there is no answer before anybody was asked. seen: whether there is a worker to ask."""
    within = f"within {timeout_s:g} s"
    if seen:
        return RequestTimeoutError(f"a detector worker was seen, but none answered {within}")
    nobody = f"no detector worker was seen {within}"
    return NotServedError(f"{nobody}: {bus.link_problem}" if bus.link_problem else nobody)


def _more_informative(before: RequestError, error: RequestError, worker: str, left_s: float) -> RequestError:
    """Return the reason that says more. error: what came of asking a worker while `left_s` were left.

    A worker that was busy and is now gone, or is silent for the little time that is left, said more before.
    """
    gone = isinstance(error, NotServedError) and isinstance(before, RefusedError)
    hurried = isinstance(error, RequestTimeoutError) and left_s < MIN_TELLING_WAIT_S
    return before if gone or hurried else type(error)(f"worker {worker}: {error}")


async def _workers(bus: Bus, until_s: float) -> list[str]:
    """Return the workers that are there: wait for the first one, and a moment for others."""
    seen: set[str] = set()
    try:
        async with asyncio.timeout_at(until_s) as limit:
            async for worker in _new_workers(bus):
                if not seen:
                    limit.reschedule(min(until_s, asyncio.get_running_loop().time() + GATHER_S))
                seen.add(worker)
    except TimeoutError:
        pass
    return sorted(seen)


async def _new_workers(bus: Bus) -> AsyncIterator[str]:
    async with bus.watch(worker_keys.every_worker_alive(worker_keys.DETECTOR)) as watch:
        async for presence in watch:
            with suppress(SchemaError):
                if presence.alive:
                    yield worker_keys.parse_worker_alive(presence.key).worker
