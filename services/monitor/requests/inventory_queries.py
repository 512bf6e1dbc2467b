"""Answers inventory queries on the bus."""

import time
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from itertools import islice
from typing import Final

from bus import Bus, RefusedError, Reply, Request
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.inventory import MAX_PROBLEMS, MAX_SIGHTINGS, ClassSighting, InventoryAnswer, InventoryRequest
from services.monitor.display import Problems
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.fleet import Fleet
from services.monitor.formats import limited
from services.monitor.inventory.inventory import Entry

WAITING: Final = 64


def answer_inventory(bus: Bus, fleet: Fleet, problems: Problems) -> AbstractAsyncContextManager[None]:
    """Answer inventory queries within the context."""

    async def answer(request: Request) -> Reply:
        try:
            asked = (
                codec.decode(InventoryRequest, request.payload, request.encoding)
                if request.payload
                else InventoryRequest()
            )
        except SchemaError as error:
            raise RefusedError(str(error)) from error
        answered = await answer_to(asked, fleet, problems(), time.time_ns())
        return Reply(codec.encode(answered), codec.encoding(InventoryAnswer))

    return bus.serve(keys.INVENTORY, answer, waiting=WAITING)


async def answer_to(asked: InventoryRequest, fleet: Fleet, problems: Sequence[str], now_ns: int) -> InventoryAnswer:
    """Return the answer to a query; other tasks run meanwhile."""
    entries = fleet.inventory.entries(now_ns, robot=asked.robot, camera=asked.camera, name=asked.name)
    found = (entry for entry in entries if entry.sighting.count or not asked.in_view)
    sightings = [_sighting(entry) async for entry in in_turns(islice(found, MAX_SIGHTINGS))]
    return InventoryAnswer(
        now_ns=now_ns,
        sightings=sightings,
        complete=next(found, None) is None,
        class_lists=fleet.class_lists,
        left_out=dict(fleet.left_out),
        problems=[problem[:MAX_LABEL] for problem in limited(problems, MAX_PROBLEMS - 1)],
    )


def _sighting(entry: Entry) -> ClassSighting:
    of = entry.sighting
    return ClassSighting(
        robot=of.key.robot,
        camera=of.key.camera,
        name=of.name,
        count=of.count,
        score=of.score,
        first_ns=of.first_ns,
        last_ns=of.last_ns,
        nearest_m=of.nearest_m,
        model=of.model,
        worker=of.worker,
        available=entry.available,
    )
