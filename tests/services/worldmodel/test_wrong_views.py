"""Views that nobody should send, and views that fail in a way that nobody expected: others count."""

import asyncio
import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress

import msgspec
import numpy as np
import pytest

from bus import QUEUE, Bus, QoS, Sample
from bus.fake import FakeNetwork
from schemas import codec
from schemas.distances import CameraView
from schemas.keys import CameraKey, Stream
from schemas.worker_keys import WorldStream, world_key
from schemas.world import SiteStatus
from services.worldmodel.floor import Floor
from services.worldmodel.model import SiteModel
from services.worldmodel.name_limits import NameLimit
from services.worldmodel.settings import WorldSettings
from services.worldmodel.site import CLOCKS_APART, FAILED, MALFORMED, OTHER_FRAME, REPLACED, Site, ViewReader
from tests.services.worldmodel.scene import NS, Camera, Thing, view
from tests.waiting import receive, until

BOX = Thing(4.0, 0.0)


@asynccontextmanager
async def serving(bus: Bus) -> AsyncIterator[Site]:
    site = Site(bus, WorldSettings(sites=["hall=*"]), "hall")
    running = asyncio.create_task(site.run())
    try:
        yield site
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running


async def send(bus: Bus, seen: CameraView, payload: bytes = b"") -> None:
    key = CameraKey(seen.header.robot, seen.header.camera).stream(Stream.VIEW)
    async with bus.publisher(key, QoS.IMAGE, encoding=codec.encoding(CameraView)) as publisher:
        await until(lambda: publisher.wanted)
        publisher.put(payload or codec.encode(seen))


async def test_a_view_that_is_turned_by_no_rotation_is_left_out_and_the_site_goes_on() -> None:
    network = FakeNetwork()
    seen = view([BOX], Camera(), 1.0)
    fields = msgspec.msgpack.decode(codec.encode(seen)) | {"rotation": [0.0, 1e10, 0.0, 0.0]}
    async with network.open_bus() as theirs, network.open_bus() as ours, serving(ours) as site:
        await send(theirs, seen)
        await until(lambda: site.model.views == 1)
        await send(theirs, seen, msgspec.msgpack.encode(fields))
        await until(lambda: MALFORMED in site._left_out())
        await send(theirs, seen)
        await until(lambda: site.model.views == 2)


async def test_views_that_are_left_out_are_told_with_their_robot_and_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    reader = ViewReader("map", NameLimit())
    seen = view([], Camera(), 1.0)
    other = msgspec.structs.replace(seen, frame_id="odom")
    key, encoding = CameraKey("r1", "front").stream(Stream.VIEW), codec.encoding(CameraView)
    late_ns = 100 * NS
    for payload, at_ns in ((b"", NS), (b"\x80", NS), (codec.encode(other), NS), (codec.encode(seen), late_ns)):
        reader.read([Sample(key, payload, encoding, at_ns, replaced=1)])
    reader.read([Sample("fleet/+/front/view", b"", encoding, NS)])
    assert dict(reader.left_out.items()) == {
        ("r1", REPLACED): 4,
        ("r1", MALFORMED): 2,
        ("r1", OTHER_FRAME): 1,
        ("r1", CLOCKS_APART): 1,
        ("", MALFORMED): 1,
    }
    assert [each.split(" left out")[0] for each in caplog.messages] == [key, "fleet/+/front/view"]
    async with FakeNetwork().open_bus() as bus:
        site = Site(bus, WorldSettings(), "main")
        site._reader = reader
        site.model.left_out["r2", FAILED] += 5
        assert site._status().problems == [
            f"{robot}: {count} sightings left out: {why}"
            for robot, count, why in (
                ("r2", 5, FAILED),
                ("r1", 2, MALFORMED),
                ("r1", 1, OTHER_FRAME),
                ("r1", 1, CLOCKS_APART),
            )
        ]
        assert site._status().left_out[MALFORMED] == 3
        site._forget(["r1"], [("r1", "front")])
        assert [each.split(":")[0] for each in site._status().problems] == ["r2"]


async def test_a_robot_whose_views_fail_is_counted_and_logged_once_and_others_count(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    take_all = SiteModel.take_all

    def fail_of_r1(self: SiteModel, views: Sequence[tuple[CameraView, int]]) -> object:
        found = take_all(self, views)
        if any(each.header.robot == "r1" for each, _ in views):
            raise ZeroDivisionError
        return found

    monkeypatch.setattr(SiteModel, "take_all", fail_of_r1)
    network = FakeNetwork()
    async with (
        network.open_bus() as theirs,
        network.open_bus() as ours,
        serving(ours) as site,
        theirs.subscribe(world_key("hall", WorldStream.STATUS), QUEUE(99)) as statuses,
    ):
        for count in (1, 2):
            for robot in ("r1", "r2"):
                await send(theirs, view([BOX], Camera(robot=robot), 1.0))
            await until(lambda count=count: site.model.left_out["r1", FAILED] == count)  # type: ignore[misc]
        await until(lambda: site.model.offsets.views[site.model.robots.number("r2")] >= 2)
        while not any(each.startswith("r1: 2 ") for each in (await receive(statuses, SiteStatus)).problems):
            pass
    assert [each.message for each in caplog.records if each.levelno == logging.ERROR] == [
        "a view of r1 left out, as are later ones like it"
    ]
    assert {robot for robot, _ in site.model.left_out} == {"r1"}


async def test_views_that_come_with_one_that_fails_count(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail_of_r1(_: Floor, seen: CameraView, __: int) -> None:
        if seen.header.robot == "r1":
            raise IndexError

    monkeypatch.setattr(Floor, "take", fail_of_r1)
    async with FakeNetwork().open_bus() as bus:
        site = Site(bus, WorldSettings(), "main")
        views = [(view([BOX], Camera(robot=robot), 1.0), NS) for robot in ("r1", "r2")]
        async with bus.publisher(world_key("main", WorldStream.CHANGES), QoS.RESULT) as told:
            site._take(told, views)
    assert dict(site.model.left_out) == {("r1", FAILED): 1}
    assert site.model.robots.names == ["r1", "r2"]


async def test_floor_that_a_robot_with_a_wrong_pose_looks_at_is_not_looked_at() -> None:
    async with FakeNetwork().open_bus() as bus:
        site = Site(bus, WorldSettings(), "main")
        async with bus.publisher(world_key("main", WorldStream.CHANGES), QoS.RESULT) as told:
            site._take(told, [(view([BOX], Camera(), 1.0), NS)])
            before = site._floor.message("main", 10 * NS)
            site._take(told, [(view([BOX], Camera(off=(60.0, 0.0, 0.0)), 4.0), 4 * NS)])
    assert before.columns > 0
    assert site._floor.message("main", 10 * NS) == before


@pytest.mark.parametrize("focal", [1e-300, 1e-6, 1.0])
def test_a_lens_that_cannot_be_shows_no_floor_far_away(focal: float) -> None:
    floor = Floor()
    seen = view([], Camera(), 5.0)
    assert seen.grid is not None
    wrong = msgspec.structs.replace(seen, grid=msgspec.structs.replace(seen.grid, fx=focal, fy=focal))
    floor.take(wrong, 5 * NS)
    said = floor.message("hall", 6 * NS)
    ages = np.frombuffer(said.ages, "<u2").reshape(said.rows, said.columns)
    assert ages.size <= 4 * 32 * 4 * 32
