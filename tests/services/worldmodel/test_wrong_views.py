"""Views that nobody should send, and views that fail in a way that nobody expected: others count."""

import asyncio
import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress

import msgspec
import numpy as np
import pytest

from bus import QUEUE, Bus, QoS
from bus.fake import FakeNetwork
from schemas import codec
from schemas.distances import CameraView
from schemas.keys import CameraKey, Stream
from schemas.worker_keys import WorldStream, world_key
from schemas.world import SiteStatus
from services.worldmodel.floor import Floor
from services.worldmodel.model import SiteModel
from services.worldmodel.settings import WorldSettings
from services.worldmodel.site import FAILED, MALFORMED, Site
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
