"""States of robots, and the survey of all."""

import msgspec
import pytest

from schemas.keys import CameraKey
from schemas.status import CameraLoad, GatewayStatus, WorkerStatus
from services.monitor.fleet import Fleet
from services.monitor.liveness import ROBOT_SILENT_NS, RobotState
from services.monitor.snapshot import FleetView, Workers
from services.monitor.web.pages.rows.robots import (
    RobotFilter,
    Survey,
    in_natural_order,
    robot_of,
    robot_summaries,
    standing,
)
from tests.services.monitor.inventory.seeing import seen as class_list
from tests.services.monitor.web.pages.shown import NOW, camera, robot


def test_a_robot_whose_cameras_speak_is_online() -> None:
    assert standing(robot(), [camera()], NOW) == (RobotState.ONLINE, "")


def test_a_robot_without_cameras_is_online_once_it_was_heard() -> None:
    assert standing(robot(), [], NOW)[0] is RobotState.ONLINE
    assert standing(robot(last_ns=0), [], NOW) == (RobotState.SILENT, "nothing heard yet")


def test_a_robot_whose_gateway_is_gone_is_offline_whatever_its_cameras_said_last() -> None:
    assert standing(robot(online=False), [camera()], NOW) == (RobotState.OFFLINE, "its gateway is gone")


@pytest.mark.parametrize(
    ("silent_ns", "state"), [(ROBOT_SILENT_NS, RobotState.ONLINE), (ROBOT_SILENT_NS + 1, RobotState.SILENT)]
)
def test_a_gateway_that_says_nothing_is_not_relied_on(silent_ns: int, state: RobotState) -> None:
    assert standing(robot(last_ns=NOW - silent_ns), [camera()], NOW)[0] is state


def test_a_robot_of_which_nobody_says_what_it_sees_is_silent_and_it_is_said_whose_fault_that_is() -> None:
    stale = camera(age_s=10)
    assert standing(robot(), [stale], NOW) == (RobotState.SILENT, "no class lists from detector/gpu-1")
    alone = camera(age_s=None, served_by=("distance/cpu-1", "opinion/gpu-2"))
    assert standing(robot(), [alone], NOW) == (RobotState.SILENT, "no detector serves its cameras")
    assert standing(robot(problems=("waits for a master",)), [stale], NOW)[1] == "waits for a master"
    assert standing(robot(), [stale, camera(name="rear")], NOW)[0] is RobotState.ONLINE


def test_a_robot_with_a_problem_that_sees_is_in_trouble() -> None:
    assert standing(robot(problems=("front/color: gone",)), [camera()], NOW) == (
        RobotState.TROUBLE,
        "front/color: gone",
    )


def test_names_are_sorted_as_people_do() -> None:
    assert in_natural_order(("r10", "Dock-1", "r2")) == ("Dock-1", "r2", "r10")


NOW_S = 100.0


def fleet() -> Fleet:
    """Return four robots: r10 and r1 see something, Dock-1 waits, r2 went."""
    made = Fleet("clock")
    for name, camera_name, seen in (
        ("r10", "front", "pallet"),
        ("r2", "front", "box"),
        ("Dock-1", "Left", "box"),
        ("r1", "front", "box"),
        ("r1", "rear", "box"),
    ):
        key = CameraKey(name, camera_name)
        made.robot_presence(name, alive=name != "r2")
        made.camera_presence(key, alive=True)
        heard_ns = 5 if name == "r2" else NOW
        made.gateway_status(GatewayStatus(robot=name, boot_id="b", clock_id="far", sent_ns=0), heard_ns)
        age_s = 9.0 if (name, camera_name) == ("r1", "front") else 3.0 if name == "r10" else 1.0
        for seq in range(1 if name == "Dock-1" else 3):
            lists = class_list(seq, {seen: 2}, key=key)
            made.see(lists, NOW_S - age_s - (2 - seq) / 2, heard_ns)
    waits = GatewayStatus(robot="Dock-1", boot_id="b", clock_id="far", sent_ns=0, waiting_for="a master")
    made.gateway_status(msgspec.structs.replace(waits, withdrawn={"late": 3}), NOW)
    return made


def survey() -> Survey:
    made = fleet()
    fleet_view = FleetView(made, Workers(made, NOW), NOW, NOW_S)
    return Survey(fleet_view, list(robot_summaries(fleet_view)))


async def names(wanted: RobotFilter) -> list[str]:
    return list(await survey().robots(wanted))


async def test_the_worst_come_first_then_by_name() -> None:
    assert await names(RobotFilter()) == ["r2", "Dock-1", "r1", "r10"]
    assert await names(RobotFilter(descending=True)) == ["r1", "r10", "Dock-1", "r2"]


async def test_robots_are_sorted_by_what_is_asked_for() -> None:
    assert await names(RobotFilter(sort="robot")) == ["Dock-1", "r1", "r2", "r10"]
    assert (await names(RobotFilter(sort="seen")))[0] == "r2"
    assert (await names(RobotFilter(sort="age")))[-1] == "r10"
    assert (await names(RobotFilter(sort="dropped")))[-1] == "Dock-1"
    assert (await names(RobotFilter(sort="dropped", descending=True)))[0] == "Dock-1"
    assert await names(RobotFilter(sort="nothing of ours")) == await names(RobotFilter())


async def test_robots_are_found_by_their_own_name_a_cameras_or_a_class() -> None:
    assert await names(RobotFilter(text=" dock ")) == ["Dock-1"]
    assert await names(RobotFilter(text="LEFT")) == ["Dock-1"]
    assert await names(RobotFilter(text="pallet")) == ["r10"]
    assert await names(RobotFilter(text="box", state=RobotState.OFFLINE)) == ["r2"]
    assert await names(RobotFilter(text="nobody")) == []


async def test_a_survey_counts() -> None:
    found = survey()
    assert found.counts == {RobotState.ONLINE: 2, RobotState.OFFLINE: 1, RobotState.TROUBLE: 1}
    assert (found.size, found.cameras, found.live_cameras, found.rate_hz) == (4, 5, 3, 6.0)
    assert await found.robots(RobotFilter()) is await found.robots(RobotFilter())


async def test_cameras_that_are_there_without_a_detector_are_named() -> None:
    made = fleet()
    for service, name in (("detector", "r1"), ("distance", "r10"), ("opinion", "r10")):
        load = CameraLoad(robot=name, camera="front", inferred=1, serving=True)
        made.worker_status(WorkerStatus(service=service, worker="w", model="m", sent_ns=0, cameras=[load]), NOW)
    found = Survey(FleetView(made, Workers(made, NOW), NOW, NOW_S), [])
    assert list(map(str, await found.unserved())) == ["Dock-1/Left", "r1/rear", "r10/front"]


def test_a_robot_is_counted_as_what_it_is_shown_as() -> None:
    made = fleet()
    fleet_view = FleetView(made, Workers(made, NOW), NOW, NOW_S)
    for each in robot_summaries(fleet_view):
        shown = robot_of(fleet_view, each)
        assert (shown.state, shown.line.last_ns, shown.line.rate_hz) == (each.state, each.last_ns, each.rate_hz)
        assert shown.line.age_s == each.age_s


def test_what_is_counted_is_what_is_shown_whatever_happens_meanwhile() -> None:
    made = fleet()
    fleet_view = FleetView(made, Workers(made, NOW), NOW, NOW_S)
    found = Survey(fleet_view, list(robot_summaries(fleet_view)))
    made.robot_presence("r1", alive=False)
    made.robot_presence("r2", alive=True)
    assert found.counts[RobotState.OFFLINE] == 1
    assert (found.robot("r1").state, found.robot("r2").state) == (RobotState.ONLINE, RobotState.OFFLINE)
    assert not found.robot("r1").cameras[1].row.stale
