"""Requests on the bus: answers inventory queries, reads robots' clocks, and has pictures saved."""

import asyncio
import logging
import time
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from itertools import islice
from typing import Final

from bus import Bus, BusError, NotServedError, RefusedError, Reply, Request, RequestError
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.inventory import MAX_PROBLEMS, MAX_SIGHTINGS, ClassSighting, InventoryAnswer, InventoryRequest
from schemas.keys import CameraKey
from schemas.models import PictureRequest, SavedPicture
from schemas.status import ClockReading
from services.monitor.display import Problems
from services.monitor.event_loop import in_turns
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


PICTURE_S: Final = 25.0
"""Time for a picture and the answer of a detector worker to it."""


class SaveImageError(Exception):
    """A picture was not saved; the message says why, and what helps."""


async def save_picture(bus: Bus, camera: CameraKey, by: str) -> SavedPicture:
    """Have a picture of a camera saved by a `fleetsight collect --asked`. by: who asks for it.

    Raises:
        SaveImageError: none runs, or it did not save it.
    """
    asked = codec.encode(PictureRequest(robot=camera.robot, camera=camera.camera, by=by))
    encoding = codec.encoding(PictureRequest)
    try:
        reply = await bus.request(keys.COLLECT, asked, encoding=encoding, timeout_s=PICTURE_S)
        return codec.decode(SavedPicture, reply.payload, reply.encoding)
    except NotServedError as error:
        raise SaveImageError("nobody collects pictures: run fleetsight collect FOLDER --asked") from error
    except (BusError, SchemaError) as error:
        raise SaveImageError(str(error)) from error


log = logging.getLogger(__name__)

LOOK_S: Final = 1.0
TIMEOUT_S: Final = 2.0
AT_ONCE: Final = 64
"""Number of robots asked concurrently."""


async def measure_clocks(bus: Bus, fleet: Fleet) -> None:
    """Keep the fleet's clock offsets up to date until cancelled."""
    room = asyncio.Semaphore(AT_ONCE)
    while True:
        async with asyncio.TaskGroup() as group:
            for robot in fleet.clocks.due(fleet.elsewhere(), time.monotonic()):
                group.create_task(_measure(bus, fleet, robot, room))
        await asyncio.sleep(LOOK_S)


async def _measure(bus: Bus, fleet: Fleet, robot: str, room: asyncio.Semaphore) -> None:
    async with room:
        asked_ns = time.time_ns()
        try:
            reply = await bus.request(keys.robot_clock(robot), timeout_s=TIMEOUT_S)
            answered_ns = time.time_ns()
            reading = codec.decode(ClockReading, reply.payload, reply.encoding)
        except (RequestError, SchemaError) as error:
            log.debug("the clock of %s is not known: %s", robot, error)
            return
    fleet.clocks.take(robot, reading, asked_ns=asked_ns, answered_ns=answered_ns)
