"""The objects of a site as a monitor follows them on the bus."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from time import time_ns

import numpy as np
import pytest

from bus import Bus, Publisher, QoS, RefusedError, Reply, Request
from bus.fake import FakeNetwork
from schemas import codec, worker_keys
from schemas.worker_keys import WorldStream
from schemas.world import ChangeKind, FloorLooks, WorldAnswer, WorldChanges, WorldObject, WorldRequest
from services.monitor.world import following
from services.monitor.world.following import ask_for_object, follow_world
from services.monitor.world.site_objects import SITE, World
from services.monitor.world.site_status import Sites
from services.worldmodel.published_objects import inside
from tests.services.monitor.world.test_floor import looks
from tests.services.monitor.world.test_site_objects import DOCK, change, changes, thing
from tests.services.monitor.world.test_site_status import status
from tests.waiting import until

KEY = worker_keys.world_key("hall", WorldStream.CHANGES)


@dataclass
class Model:
    """A world model's answers. most: objects that fit into one. refuses: why it answers nothing."""

    objects: Sequence[WorldObject] = ()
    last: int = 0
    most: int = 100
    refuses: str = ""
    asked: list[str] = field(default_factory=list)
    regions: list[list[tuple[float, float]]] = field(default_factory=list)

    async def answer(self, request: Request) -> Reply:
        asked = codec.decode(WorldRequest, request.payload, request.encoding)
        self.asked.append(asked.name)
        self.regions.append(asked.region)
        if self.refuses:
            raise RefusedError(self.refuses)
        found = [each for each in self.objects if asked.name in ("", each.name) and _is_in(each, asked.region)]
        answer = WorldAnswer(
            site="hall",
            epoch="e",
            last=self.last,
            now_ns=7,
            objects=found[: self.most],
            complete=len(found) <= self.most,
        )
        return Reply(codec.encode(answer), codec.encoding(WorldAnswer))


def _is_in(of: WorldObject, region: list[tuple[float, float]]) -> bool:
    return not region or bool(inside(np.array([of.at[:2]]), region)[0])


@dataclass
class Hall:
    """A site that a monitor follows."""

    model: Model
    world: World
    bus: Bus
    told: Publisher

    @property
    def boxes(self) -> int:
        return self.world.sites["hall"].count("dock").get("box", 0)


@asynccontextmanager
async def hall_of(model: Model, *, serves: bool = True, zones: bool = True) -> AsyncIterator[Hall]:
    network, world, sites = FakeNetwork(), World([DOCK] if zones else ()), Sites()
    sites.take(status("hall", box=1, pallet=1), time_ns())
    async with AsyncExitStack() as stack:
        theirs, ours = [await stack.enter_async_context(network.open_bus()) for _ in range(2)]
        if serves:
            await stack.enter_async_context(
                theirs.serve(worker_keys.world_key("hall", WorldStream.OBJECTS), model.answer)
            )
        told = await stack.enter_async_context(
            theirs.publisher(KEY, QoS.RESULT, encoding=codec.encoding(WorldChanges), kept=100)
        )
        following = asyncio.create_task(follow_world(ours, world, sites))
        try:
            yield Hall(model, world, theirs, told)
        finally:
            following.cancel()
            await asyncio.wait([following])


async def test_a_late_joiner_asks_for_all_and_goes_on_with_changes() -> None:
    async with hall_of(Model([thing("a", 1), thing("b", 2)], last=7)) as hall:
        await until(lambda: hall.boxes == 2)
        hall.told.put(codec.encode(changes(8, change(ChangeKind.GONE, thing("a", 1)))))
        await until(lambda: hall.boxes == 1)
        assert hall.model.asked == [""]


async def test_after_a_gap_all_are_asked_for_again() -> None:
    async with hall_of(Model([thing("a", 1)], last=1)) as hall:
        await until(lambda: hall.boxes == 1)
        hall.model.objects, hall.model.last = [thing("a", 1), thing("b", 1), thing("c", 1)], 5
        hall.told.put(codec.encode(changes(4, *[change(ChangeKind.SEEN, thing("a", 1))] * 2)))
        await until(lambda: hall.boxes == 3)


async def test_what_does_not_fit_into_one_answer_is_asked_for_by_class() -> None:
    objects = [thing("a", 1), thing("b", 1), thing("p", 1, name="pallet")]
    async with hall_of(Model(objects, most=2)) as hall:
        await until(lambda: hall.boxes == 2)
        assert hall.world.sites["hall"].count("dock") == {"box": 2, "pallet": 1}
        assert hall.model.asked == ["", "box", "pallet"]


async def test_a_class_that_does_not_fit_into_one_answer_is_asked_for_in_parts_of_the_map() -> None:
    boxes = [thing(f"b{number:03}", number % 25, number // 25) for number in range(500)]
    shelf = [thing(f"s{number}", -2.0, number / 100) for number in range(50)]
    pallet = thing("p", 1, name="pallet")
    async with hall_of(Model([*boxes, *shelf, pallet], most=20)) as hall:
        await until(lambda: hall.boxes)
        objects = hall.world.sites["hall"]
        assert objects.count(SITE) == {"box": 550, "pallet": 1}
        assert (objects.is_full, list(hall.world.problems())) == (False, [])
        assert len(hall.model.asked) < 150


async def test_where_parts_of_the_map_cannot_be_made_smaller_it_is_told_that_not_all_are_followed() -> None:
    pile = [thing(f"b{number}", 1) for number in range(30)]
    async with hall_of(Model([thing("far", 9), *pile], most=20)) as hall:
        await until(lambda: hall.boxes)
        objects = hall.world.sites["hall"]
        assert (hall.boxes, "far" in objects.objects, objects.is_full) == (20, True, True)
        (problem,) = hall.world.problems()
        assert problem.startswith("site hall has more than 21 objects; the others are counted nowhere")


async def test_a_refused_question_is_asked_again_and_told_once(caplog: pytest.LogCaptureFixture) -> None:
    async with hall_of(Model([thing("a", 1)], refuses="not yet")) as hall:
        await until(lambda: len(hall.model.asked) == 2)
        hall.model.refuses = ""
        await until(lambda: hall.boxes == 1)
    assert sum("not yet" in each.message for each in caplog.records) == 1


async def test_messages_that_are_none_are_left_out(caplog: pytest.LogCaptureFixture) -> None:
    async with hall_of(Model([thing("a", 1)], last=1)) as hall:
        await until(lambda: hall.boxes == 1)
        hall.told.put(b"none")
        elsewhere = WorldChanges(site="yard", epoch="e", first=2, sent_ns=0, changes=[])
        hall.told.put(codec.encode(elsewhere))
        hall.told.put(codec.encode(changes(2, change(ChangeKind.APPEARED, thing("b", 1)))))
        await until(lambda: hall.boxes == 2)
    assert sum("left out" in each.message for each in caplog.records) == 2


async def test_the_floor_is_asked_for_while_a_rule_needs_it() -> None:
    async def answer(_: Request) -> Reply:
        return Reply(codec.encode(looks([[7] * 4] * 4)), codec.encoding(FloorLooks))

    async with hall_of(Model()) as hall, hall.bus.serve(worker_keys.world_key("hall", WorldStream.FLOOR), answer):
        objects = hall.world.sites["hall"]
        await until(lambda: not objects.is_behind)
        assert not objects.floor
        objects.floor_wanted = frozenset({"dock"})
        await until(lambda: objects.floor)
        assert objects.floor["dock"].share_seen(30, objects.floor["dock"].at_ns) == 1


async def test_looks_at_the_floor_outlive_the_worker_that_told_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(following, "FLOOR_EVERY_S", 0.01)
    ages = [7]

    async def answer(_: Request) -> Reply:
        return Reply(codec.encode(looks([[ages[-1]] * 4] * 4)), codec.encoding(FloorLooks))

    async with hall_of(Model()) as hall, hall.bus.serve(worker_keys.world_key("hall", WorldStream.FLOOR), answer):
        objects = hall.world.sites["hall"]
        objects.floor_wanted = frozenset({"dock"})
        await until(lambda: objects.floor)
        ages.append(65_535)
        asked_ns = time_ns()
        await until(lambda: objects.floor["dock"].at_ns > asked_ns)
        assert objects.floor["dock"].share_seen(30, objects.floor["dock"].at_ns) == 1


async def test_a_site_that_a_world_model_tells_of_is_followed_though_it_has_no_zones() -> None:
    async with hall_of(Model([thing("a", 1)], last=1), zones=False) as hall:
        assert not hall.world.sites
        hall.world.hear(status("hall", box=1))
        await until(lambda: "a" in hall.world.sites["hall"].objects)
        assert hall.world.sites["hall"].count(SITE) == {"box": 1}


async def test_a_world_that_is_off_subscribes_to_nothing() -> None:
    network, world = FakeNetwork(), World(on=False)
    world.hear(status("hall"))
    async with network.open_bus() as theirs, network.open_bus() as ours:
        await follow_world(ours, world, Sites())  # ends at once, as there is nothing to follow
        async with theirs.publisher(KEY, QoS.RESULT, encoding=codec.encoding(WorldChanges)) as publisher:
            await asyncio.sleep(0.1)
            assert not publisher.wanted


async def test_one_object_is_asked_for_as_it_is_now() -> None:
    model = Model([thing("a", 1)], last=1)
    async with hall_of(model) as hall:
        await until(lambda: hall.boxes == 1)
        model.objects = [thing("b", 1), thing("a", 1.5)]
        found = await ask_for_object(hall.bus, thing("a", 1))
        assert found is not None
        assert (found.of, found.now_ns) == (thing("a", 1.5), 7)
        assert await ask_for_object(hall.bus, thing("gone", 1)) is None
        model.refuses = "not now"
        assert await ask_for_object(hall.bus, thing("a", 1)) is None
