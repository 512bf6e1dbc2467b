"""Follows the changes of sites on the bus, and asks for all objects of a site where some were missed."""

import asyncio
import logging
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from bus import QUEUE, Bus, RequestError, Sample
from schemas import codec
from schemas.errors import SchemaError
from schemas.worker_keys import WorldStream, world_key
from schemas.world import FloorLooks, WorldAnswer, WorldChanges, WorldObject, WorldRequest
from services.monitor.event_loop import AT_ONCE
from services.monitor.map.sites import Sites
from services.monitor.world.floor import floor_of
from services.monitor.world.site_objects import SiteObjects, World

log = logging.getLogger(__name__)

DEPTH: Final = 10_000
MOST_BYTES: Final = 32 << 20
KEPT: Final = 100
"""Messages that a world model keeps for late subscribers."""

ASK_EVERY_S: Final = 1.0
FLOOR_EVERY_S: Final = 10.0
TIMEOUT_S: Final = 10.0


async def follow_world(bus: Bus, world: World, sites: Sites) -> None:
    """Keep the objects of all sites up to date until cancelled; a world that is off has none.

    sites: whose world models are there: the others are not asked.
    """
    followed: set[str] = set()
    async with asyncio.TaskGroup() as group:
        while world.on:
            for name in world.sites.keys() - followed:
                objects = world.sites[name]
                followed.add(name)
                group.create_task(_receive(bus, name, objects))
                group.create_task(_catch_up(bus, name, objects, sites))
                group.create_task(_look_at_floor(bus, name, objects, sites))
            await asyncio.sleep(ASK_EVERY_S)


async def _receive(bus: Bus, site: str, objects: SiteObjects) -> None:
    key = world_key(site, WorldStream.CHANGES)
    async with bus.subscribe(key, QUEUE(DEPTH, MOST_BYTES), recover=KEPT) as subscription:
        async for batch in subscription.batches(AT_ONCE):
            for sample in batch:
                try:
                    objects.take(_changes(sample, site))
                except SchemaError as error:
                    log.warning("%s: left out: %s", sample.key, error)
            await asyncio.sleep(0)  # lets other tasks run while more messages wait


def _changes(sample: Sample, site: str) -> WorldChanges:
    changes = codec.decode(WorldChanges, sample.payload, sample.encoding)
    if changes.site != site:
        raise SchemaError(f"changes of site {changes.site}")
    return changes


async def _catch_up(bus: Bus, site: str, objects: SiteObjects, sites: Sites) -> None:
    failed = ""
    while True:
        if objects.is_behind and sites.is_current(site, time.time_ns()):
            try:
                await _ask_for_all(bus, site, objects, sites)
                failed = ""
            except (RequestError, SchemaError) as error:
                if str(error) != failed:
                    log.warning("site %s: its objects are asked for again: %s", site, error)
                failed = str(error)
        await asyncio.sleep(ASK_EVERY_S)


async def _look_at_floor(bus: Bus, site: str, objects: SiteObjects, sites: Sites) -> None:
    """Ask when the floor was looked at, while a rule needs it."""
    while True:
        if objects.floor_wanted and sites.is_current(site, time.time_ns()):
            try:
                reply = await bus.request(world_key(site, WorldStream.FLOOR), timeout_s=TIMEOUT_S)
                looks = codec.decode(FloorLooks, reply.payload, reply.encoding)
                zones = [zone for zone in objects.zones if zone.name in objects.floor_wanted]
                objects.floor = await asyncio.to_thread(floor_of, zones, looks, time.time_ns())
            except (RequestError, SchemaError) as error:
                log.warning("site %s: its floor is asked for again: %s", site, error)
        await asyncio.sleep(FLOOR_EVERY_S if objects.floor else ASK_EVERY_S)


async def _ask_for_all(bus: Bus, site: str, objects: SiteObjects, sites: Sites) -> None:
    """Ask for all objects; class by class where they do not fit into one answer."""
    answers = [await _ask(bus, site, WorldRequest())]
    if not answers[0].complete:
        first = answers.pop()
        names = {*sites.classes(site), *(each.name for each in first.objects)}
        answers = [await _ask(bus, site, WorldRequest(name=name)) for name in sorted(names)]
    epochs = {answer.epoch for answer in answers}
    if len(epochs) == 1:  # else another worker took the site over meanwhile: ask again
        objects.replace(epochs.pop(), min(answer.last for answer in answers), _every(answers))


def _every(answers: Iterable[WorldAnswer]) -> Iterable[WorldObject]:
    return (each for answer in answers for each in answer.objects)


AROUND_M: Final = 5.0
"""Half the side of the square in which one object is asked for: further than anything goes between two questions."""

ONE_TIMEOUT_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class FreshObject:
    """An object as its world model has it at `now_ns`, on the model's clock."""

    of: WorldObject
    now_ns: int


async def ask_for_object(bus: Bus, of: WorldObject) -> FreshObject | None:
    """Ask for an object as it is now: changes tell every ten seconds or so that one is still seen.

    of: the object as it was told last. None where it is not there any more, or nobody answers.
    """
    x, y = of.at[:2]
    around = [
        (x + dx, y + dy)
        for dx, dy in ((-AROUND_M, -AROUND_M), (AROUND_M, -AROUND_M), (AROUND_M, AROUND_M), (-AROUND_M, AROUND_M))
    ]
    try:
        answer = await _ask(bus, of.site, WorldRequest(name=of.name, region=around), ONE_TIMEOUT_S)
    except (RequestError, SchemaError):
        return None
    found = next((each for each in answer.objects if each.id == of.id), None)
    return None if found is None else FreshObject(found, answer.now_ns)


async def _ask(bus: Bus, site: str, question: WorldRequest, timeout_s: float = TIMEOUT_S) -> WorldAnswer:
    encoding = codec.encoding(WorldRequest)
    key = world_key(site, WorldStream.OBJECTS)
    reply = await bus.request(key, codec.encode(question), encoding=encoding, timeout_s=timeout_s)
    return codec.decode(WorldAnswer, reply.payload, reply.encoding)


async def ask_for_floor(bus: Bus, site: str) -> FloorLooks | None:
    """Ask when the floor of a site was looked at; None if nobody answers."""
    try:
        reply = await bus.request(world_key(site, WorldStream.FLOOR), timeout_s=ONE_TIMEOUT_S)
        return codec.decode(FloorLooks, reply.payload, reply.encoding)
    except (RequestError, SchemaError):
        return None
