"""Follows the changes of sites on the bus, and asks for all objects of a site where some were missed."""

import asyncio
import logging
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, median
from typing import Final

from bus import QUEUE, Bus, RequestError, Sample
from schemas import codec
from schemas.errors import SchemaError
from schemas.space import MAX_COORDINATE_M
from schemas.worker_keys import WorldStream, world_key
from schemas.world import FloorLooks, WorldAnswer, WorldChanges, WorldObject, WorldRequest
from services.monitor.event_loop.cooperative_yielding import AT_ONCE
from services.monitor.world.floor import floor_of
from services.monitor.world.site_objects import MAX_SITE_OBJECTS, SiteObjects, World
from services.monitor.world.site_status import Sites

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
                looks = await _floor(bus, site, TIMEOUT_S)
                zones = [zone for zone in objects.zones if zone.name in objects.floor_wanted]
                floor = await asyncio.to_thread(floor_of, zones, looks, time.time_ns(), objects.floor)
                objects.floor = {zone.name: floor[zone.name] for zone in zones if zone in objects.zones}
            except (RequestError, SchemaError) as error:
                log.warning("site %s: its floor is asked for again: %s", site, error)
        await asyncio.sleep(FLOOR_EVERY_S if objects.floor else ASK_EVERY_S)


async def _ask_for_all(bus: Bus, site: str, objects: SiteObjects, sites: Sites) -> None:
    """Ask for all objects; class by class where they do not fit into one answer, and of a class part by part."""
    answers = [await _ask(bus, site, WorldRequest())]
    complete = answers[0].complete
    if not complete:
        first = answers.pop()
        names = {*sites.classes(site), *(each.name for each in first.objects)}
        complete = True
        for name in sorted(names):
            some, all_of_it = await _ask_for_class(bus, site, name)
            answers += some
            complete = complete and all_of_it
    epochs = {answer.epoch for answer in answers}
    if len(epochs) == 1:  # else another worker took the site over meanwhile: ask again
        last = min(answer.last for answer in answers)
        objects.replace(epochs.pop(), last, _every(answers), complete=complete)


async def _ask_for_class(bus: Bus, site: str, name: str) -> tuple[list[WorldAnswer], bool]:
    """Ask for the objects of a class; in parts of the map where they do not fit into one answer.

    Also return whether these are all: there may be more than are followed, or too many at one place.
    """
    answers, parts, complete = list[WorldAnswer](), [Part()], True
    for _ in range(MOST_PARTS):
        if not parts or sum(len(each.objects) for each in answers) >= MAX_SITE_OBJECTS:
            break
        part = parts.pop()
        answer = await _ask(bus, site, WorldRequest(name=name, region=part.corners if part.depth else []))
        smaller = [] if answer.complete else part.split(answer.objects)
        if smaller:
            parts += smaller
        else:
            answers.append(answer)
            complete = complete and answer.complete
    return answers, complete and not parts


MOST_PARTS: Final = 200
"""Parts of the map in which a class is asked for, at most."""

MOST_SPLITS: Final = 10


@dataclass(frozen=True, slots=True)
class Part:
    """A rectangle of the map, all of it unless given, in metres; its west and south sides belong to it.

    depth: how often the map was split for it.
    """

    west: float = -MAX_COORDINATE_M
    south: float = -MAX_COORDINATE_M
    east: float = MAX_COORDINATE_M
    north: float = MAX_COORDINATE_M
    depth: int = 0

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Its corners in order around it."""
        return [(self.west, self.south), (self.east, self.south), (self.east, self.north), (self.west, self.north)]

    def split(self, objects: Sequence[WorldObject]) -> "list[Part]":
        """Return parts with about a quarter of these objects each; none if it cannot be split."""
        if self.depth == MOST_SPLITS or not objects:
            return []
        xs = (self.west, *_between([each.at[0] for each in objects]), self.east)
        ys = (self.south, *_between([each.at[1] for each in objects]), self.north)
        parts = [
            Part(west, south, east, north, self.depth + 1)
            for west, east in pairwise(xs)
            for south, north in pairwise(ys)
        ]
        return parts if len(parts) > 1 else []


def _between(values: Sequence[float]) -> list[float]:
    """Return what parts values into halves, or into those that are the least and the others; none if all are equal."""
    least = min(values)
    return [cut for cut in (median(values), fmean(values)) if cut > least][:1]


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
        return await _floor(bus, site, ONE_TIMEOUT_S)
    except (RequestError, SchemaError):
        return None


async def _floor(bus: Bus, site: str, timeout_s: float) -> FloorLooks:
    reply = await bus.request(world_key(site, WorldStream.FLOOR), timeout_s=timeout_s)
    return codec.decode(FloorLooks, reply.payload, reply.encoding)
