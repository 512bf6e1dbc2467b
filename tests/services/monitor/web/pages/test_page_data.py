"""Data shared by all pages."""

import asyncio
import time
from pathlib import Path

import msgspec

from bus.fake import FakeNetwork
from schemas.alerts import AlertState
from schemas.keys import CameraKey
from schemas.world import RobotOffset
from services.monitor.history.archive import Archive
from services.monitor.history.store import Store
from services.monitor.web.pages.alerts import KeptAlerts
from services.monitor.web.pages.health import MAX_NAMED, facts
from services.monitor.web.pages.page_data import PageData
from services.monitor.web.pages.rows.robots import RobotFilter
from services.worldmodel.offsets import LOST, REASONS
from tests.schemas.results import distances
from tests.services.monitor.inventory.seeing import seen
from tests.services.monitor.web.pages.rows.test_alerts import ALERT
from tests.services.monitor.web.serving import monitor_on
from tests.services.monitor.world.test_site_status import status
from tests.waiting import until


async def test_all_who_look_at_once_share_what_they_see() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        monitor.fleet.robot_presence("r1", alive=True)
        shared = PageData(monitor)
        survey = await shared.survey()
        assert await shared.survey() is survey
        assert await survey.robots(RobotFilter()) == ["r1"]
        assert (await shared.sightings()).entries == ()


async def test_why_there_are_none_is_said() -> None:
    assert "--history none" in (await KeptAlerts(Archive("none")).ended()).problem


async def test_only_what_ended_is_found(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.db'}"
    store = await Store.open(url)
    ended = msgspec.structs.replace(ALERT, id="2", state=AlertState.RESOLVED)
    await store.write([], [ALERT, ended], 1)
    await store.close()
    found = await KeptAlerts(Archive(url)).ended()
    assert [alert.id for alert in found.alerts] == ["2"]
    assert found.problem == ""


S = 1_000_000_000


async def test_a_monitor_says_how_it_is() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        monitor.fleet.left_out["malformed messages"] += 1_200
        said = dict(facts(monitor, monitor.started_ns + 65 * S))
    assert said["Robots join at"] == "tcp/127.0.0.1:7447"
    assert said["Running for"] == "1 min"
    assert said["History"] == "not kept: started with --history none"
    assert said["Rules"] == "none: start with --rules rules.yaml"
    assert said["Left out"] == "1,200 malformed messages"
    assert (said["Class lists rejected"], said["Second opinions ignored"]) == ("none", "none")
    assert said["Distances ignored"] == "none"


async def test_a_monitor_says_which_world_models_it_hears_and_what_is_wrong_with_them() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)

        def said() -> str:
            return dict(facts(monitor, monitor.started_ns))["World models"]

        assert said().startswith("none runs: fleetsight worldmodel")
        lost = RobotOffset(robot="r1", x=0, y=0, yaw=0, sigma_m=0, doubted=REASONS[LOST], views=1, last_ns=1)
        monitor.fleet.sites.take(msgspec.structs.replace(status("hall"), robots=[lost]), time.time_ns())
        assert said().startswith(f"hall by w; site hall leaves out the sightings of r1: {REASONS[LOST]}; correct that")
        assert [each for each in monitor.problems() if "r1" in each] == [said().removeprefix("hall by w; ")]
        off = monitor_on(bus, world="off")
        assert dict(facts(off, off.started_ns))["World models"] == "not followed: started with --world off"


async def test_a_monitor_says_which_cameras_lists_come_late_and_how_many_opinions_do() -> None:
    async with FakeNetwork().open_bus() as bus:
        monitor = monitor_on(bus)
        for number in range(MAX_NAMED + 2):
            for _ in range(3 if number == 4 else 2):
                monitor.fleet.see(seen(1, {"box": 1}, key=CameraKey("r1", f"c{number}")), 1.0, S)
        for _ in range(3):
            monitor.fleet.opine(seen(1, {"box": 1}, key=CameraKey("r1", "c0")), S)
            monitor.fleet.measure(distances(camera="c0"), S)
        said = dict(facts(monitor, monitor.started_ns))
    assert said["Class lists rejected"] == (
        "9 that were duplicate, late or out of order: r1/c4 2, r1/c0 1, r1/c1 1, r1/c2 1, r1/c3 1, r1/c5 1"
        " and 2 more cameras"
    )
    assert said["Second opinions ignored"] == "2 that were duplicate, late, or of cameras that are not known"
    assert said["Distances ignored"] == "2 that were duplicate, late or out of order"


async def test_a_monitor_whose_database_is_not_there_yet_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    async with FakeNetwork().open_bus() as bus, asyncio.TaskGroup() as group:
        monitor = monitor_on(bus, history=f"sqlite:///{tmp_path}/file/history.db")
        keeping = group.create_task(monitor.history.run())
        await until(lambda: bool(monitor.history.status.problem))
        said = dict(facts(monitor, monitor.started_ns))
        keeping.cancel()
    assert said["History"].startswith("not kept: ")
