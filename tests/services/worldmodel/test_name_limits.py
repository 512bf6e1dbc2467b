"""Names of robots and cameras are bounded, however many views claim to be of others."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import numpy as np
import pytest

from bus import QUEUE, Bus, QoS, Sample
from bus.fake import FakeNetwork
from schemas import codec
from schemas.distances import CameraView
from schemas.keys import NEARBY, CameraKey, Stream
from schemas.worker_keys import WorldStream, world_key
from schemas.world import MAX_ROBOT_CAMERAS, MAX_ROBOTS, NearbyObjects, SiteStatus, WorldRequest
from services.worldmodel import name_limits
from services.worldmodel.floor import Floor
from services.worldmodel.model import UNLOCATED, SiteModel
from services.worldmodel.name_limits import (
    ABSENT_NS,
    TOO_MANY_CAMERAS,
    TOO_MANY_ROBOTS,
    LeftOutCounts,
    NameLimit,
    NameNumbers,
)
from services.worldmodel.published_objects import PublishedObjects
from services.worldmodel.settings import WorldSettings
from services.worldmodel.site import Site, ViewReader
from services.worldmodel.state import restored, saved
from tests.services.worldmodel.scene import NS, Camera, Thing, known, view, watch
from tests.waiting import receive, until

THINGS = [Thing(3.0, 0.8), Thing(4.0, -0.9)]


def sample(robot: str, camera: str = "front", at_ns: int = NS) -> Sample:
    payload = codec.encode(view_of(robot, camera))
    return Sample(CameraKey(robot, camera).stream(Stream.VIEW), payload, codec.encoding(CameraView), at_ns)


def view_of(robot: str, camera: str = "front") -> CameraView:
    return view([], Camera(robot=robot, name=camera), 1.0)


def test_a_site_reads_views_of_so_many_robots_until_one_is_absent_for_long() -> None:
    name_limit = NameLimit()
    reader = ViewReader("map", name_limit)
    for number in range(MAX_ROBOTS):
        assert not name_limit.admit(f"r{number}", "front", NS + number)
    assert reader.read([sample("new", at_ns=2 * NS)]) == []
    assert dict(reader.left_out.items()) == {("new", TOO_MANY_ROBOTS): 1}
    assert len(reader.read([sample("r0", at_ns=2 * NS)])) == 1
    assert name_limit.take_left() == ([], [])
    assert len(reader.read([sample("new", at_ns=NS + 1 + ABSENT_NS)])) == 1
    assert name_limit.take_left() == (["r1"], [("r1", "front")])
    assert name_limit.take_left() == ([], [])


def test_a_robot_has_so_many_cameras_and_others_have_theirs() -> None:
    name_limit = NameLimit()
    reader = ViewReader("map", name_limit)
    assert len(reader.read([sample("r1", f"c{number}") for number in range(MAX_ROBOT_CAMERAS)])) == MAX_ROBOT_CAMERAS
    assert reader.read([sample("r1", "new")]) == []
    assert dict(reader.left_out.items()) == {("r1", TOO_MANY_CAMERAS): 1}
    assert len(reader.read([sample("r2", "new"), sample("r1", "c0", 2 * NS)])) == 2
    assert len(reader.read([sample("r1", "new", NS + ABSENT_NS)])) == 1
    assert name_limit.take_left() == ([], [("r1", "c1")])


def test_cameras_that_a_restored_model_knows_have_their_place() -> None:
    name_limit = NameLimit([("r1", "front")], NS, most_robots=1, most_cameras=1)
    assert name_limit.admit("r2", "front", 2 * NS) == TOO_MANY_ROBOTS
    assert name_limit.admit("r1", "rear", 2 * NS) == TOO_MANY_CAMERAS
    assert name_limit.admit("r1", "front", 2 * NS) == ""


def test_what_was_left_out_is_counted_by_robot_of_so_many() -> None:
    left_out = LeftOutCounts(most_robots=2)
    assert [left_out.add("r1", "late"), left_out.add("r1", "late"), left_out.add("r1", "new", 2)] == [True, False, True]
    assert left_out.add("r2", "late")
    left_out.add("r1", "late")
    assert not left_out.add("r3", "late")  # one of as many names as anybody likes
    assert dict(left_out.items()) == {("r1", "late"): 3, ("r1", "new"): 2, ("r3", "late"): 1, ("", "late"): 1}
    left_out.forget(["r1", "nobody"])
    assert dict(left_out.items()) == {("r3", "late"): 1, ("", "late"): 4, ("", "new"): 2}
    assert left_out.by_reason == {"late": 5, "new": 2}


def test_numbers_of_forgotten_names_are_given_again() -> None:
    numbers = NameNumbers("")
    assert [numbers.number(name) for name in ("a", "b", "c", "a")] == [0, 1, 2, 0]
    assert numbers.forget(["b", "nobody"]) == [1]
    assert (numbers.find("b"), numbers.names, dict(numbers.items())) == (None, ["a", "", "c"], {"a": 0, "c": 2})
    again = NameNumbers("")
    again.restore(numbers.names)
    for each in (numbers, again):
        assert [each.number(name) for name in ("d", "c", "e")] == [1, 2, 3]


def test_a_robot_that_is_forgotten_leaves_what_it_saw_and_nothing_of_itself() -> None:
    model = SiteModel()
    watch(model, THINGS, [Camera(robot="r1"), Camera(0.5, 0.0, robot="r2")], 1.0, 6)
    model.left_out["r1", UNLOCATED] += 2
    before = known(model)
    model.forget({"r1"}, [("r1", "front")])
    assert known(model) == before
    published = PublishedObjects("hall", "a1", model)
    assert [each.robot for each in published.robots()] == ["r2"]
    assert published.nearby("r1", 8.0, 0) == []
    objects, _ = published.matching(WorldRequest(), 10 * NS)
    assert {seer.robot for each in objects for seer in each.seen_by} == {"r2"}
    assert model.left_out["", UNLOCATED] == 2
    again = SiteModel()
    restored("hall", saved("hall", "a1", 7, model), again)
    assert PublishedObjects("hall", "a1", again).matching(WorldRequest(), 10 * NS)[0] == objects

    watch(model, THINGS, [Camera(20.0, 0.0, np.pi, robot="r3")], 5.0, 1)  # a jump, were it r1 still
    assert (model.robots.names, model.cameras.names) == (["r3", "r2"], [("r3", "front"), ("r2", "front")])
    (newest,) = [each for each in published.robots() if each.robot == "r3"]
    assert (newest.views, newest.doubted) == (1, "")


def test_the_floor_forgets_when_a_camera_is_due() -> None:
    floor = Floor()
    floor.take(view([], Camera(), 5.0), 5 * NS)
    before = floor.message("hall", 6 * NS).columns
    elsewhere = view([], Camera(100.0, 0.0), 5.5)
    floor.take(elsewhere, 5 * NS + 1)
    assert floor.message("hall", 6 * NS).columns == before
    floor.forget([("r1", "front")])
    floor.take(elsewhere, 5 * NS + 1)
    assert floor.message("hall", 6 * NS).columns > before


@asynccontextmanager
async def serving(bus: Bus) -> AsyncIterator[None]:
    site = Site(bus, WorldSettings(sites=["hall=*"], nearby_hz=20), "hall")
    running = asyncio.create_task(site.run())
    try:
        yield
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running


async def test_a_full_site_says_so_and_takes_a_new_robot_for_one_that_is_absent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("services.worldmodel.site.NameLimit", lambda *known: NameLimit(*known, most_robots=2))
    network = FakeNetwork()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        serving(ours),
        theirs.subscribe(world_key("hall", WorldStream.STATUS), QUEUE(99)) as statuses,
        theirs.subscribe(f"fleet/*/{NEARBY}", QUEUE(999)) as nearby,
        asyncio.timeout(60),
    ):

        async def until_it_says(robots: list[str], left_out: int) -> None:
            while True:
                status = await receive(statuses, SiteStatus)
                seen = [each.robot for each in status.robots]
                if (seen, status.left_out.get(TOO_MANY_ROBOTS, 0)) == (robots, left_out):
                    return

        async def send(robot: str) -> None:
            key = CameraKey(robot, "front").stream(Stream.VIEW)
            async with theirs.publisher(key, QoS.IMAGE, encoding=codec.encoding(CameraView)) as publisher:
                await until(lambda: publisher.wanted)
                publisher.put(codec.encode(view_of(robot)))

        for robot in ("r1", "r2", "r3"):
            await send(robot)
        await until_it_says(["r1", "r2"], 1)
        monkeypatch.setattr(name_limits, "ABSENT_NS", 0)
        await send("r3")
        await until_it_says(["r2", "r3"], 1)
        while (await receive(nearby, NearbyObjects)).robot != "r3":
            pass
        assert {(await receive(nearby, NearbyObjects)).robot for _ in range(9)} == {"r2", "r3"}
