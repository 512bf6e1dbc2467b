import pytest

from services.monitor.page.robots import QUIET_NS, RobotState, Survey, Wanted, standing
from tests.services.monitor.page.picturing import NOW, camera, picture, robot


def test_a_robot_whose_cameras_speak_is_online() -> None:
    assert standing(robot(), [camera()], NOW) == (RobotState.ONLINE, "")


def test_a_robot_without_cameras_is_online_once_it_was_heard() -> None:
    assert standing(robot(), [], NOW)[0] is RobotState.ONLINE
    assert standing(robot(last_ns=0), [], NOW) == (RobotState.SILENT, "nothing heard yet")


def test_a_robot_whose_gateway_is_gone_is_offline_whatever_its_cameras_said_last() -> None:
    assert standing(robot(online=False), [camera()], NOW) == (RobotState.OFFLINE, "its gateway is gone")


@pytest.mark.parametrize(("silent_ns", "state"), [(QUIET_NS, RobotState.ONLINE), (QUIET_NS + 1, RobotState.SILENT)])
def test_a_gateway_that_says_nothing_is_not_relied_on(silent_ns: int, state: RobotState) -> None:
    assert standing(robot(last_ns=NOW - silent_ns), [camera()], NOW)[0] is state


def test_a_robot_of_which_nobody_says_what_it_sees_is_silent_and_it_is_said_whose_fault_that_is() -> None:
    stale = camera(age_s=10)
    assert standing(robot(), [stale], NOW) == (RobotState.SILENT, "no class lists from detector/gpu-1")
    alone = camera(age_s=None, served_by=("distance/cpu-1",))
    assert standing(robot(), [alone], NOW) == (RobotState.SILENT, "no detector looks after its cameras")
    assert standing(robot(problems=("waits for a master",)), [stale], NOW)[1] == "waits for a master"
    assert standing(robot(), [stale, camera(name="rear")], NOW)[0] is RobotState.ONLINE


def test_a_robot_with_a_problem_that_sees_is_in_trouble() -> None:
    assert standing(robot(problems=("front/color: gone",)), [camera()], NOW) == (
        RobotState.TROUBLE,
        "front/color: gone",
    )


def survey() -> Survey:
    robots = [
        robot("r10", age_s=3.0),
        robot("r2", online=False, last_ns=5),
        robot("Dock-1", problems=("waits",), age_s=None),
        robot("r1", last_ns=NOW - 1),
    ]
    cameras = [
        camera("r10", classes=[("pallet", 1)]),
        camera("r2", online=False),
        camera("Dock-1", "Left"),
        camera("r1", age_s=9),
        camera("r1", "rear"),
    ]
    return Survey(picture(robots, cameras))


def names(wanted: Wanted) -> list[str]:
    return [found.line.name for found in survey().robots(wanted)]


def test_the_worst_come_first_then_by_name() -> None:
    assert names(Wanted()) == ["r2", "Dock-1", "r1", "r10"]
    assert names(Wanted(descending=True)) == ["r1", "r10", "Dock-1", "r2"]


def test_robots_are_sorted_by_what_is_asked_for() -> None:
    assert names(Wanted(sort="robot")) == ["Dock-1", "r1", "r2", "r10"]
    assert names(Wanted(sort="seen"))[0] == "r2"
    assert names(Wanted(sort="age"))[-1] == "Dock-1"
    assert names(Wanted(sort="nothing of ours")) == names(Wanted())


def test_robots_are_found_by_their_own_name_a_cameras_or_a_class() -> None:
    assert names(Wanted(text=" dock ")) == ["Dock-1"]
    assert names(Wanted(text="LEFT")) == ["Dock-1"]
    assert names(Wanted(text="pallet")) == ["r10"]
    assert names(Wanted(text="box", state=RobotState.OFFLINE)) == ["r2"]
    assert names(Wanted(text="nobody")) == []


def test_a_survey_counts() -> None:
    found = survey()
    assert found.counts == {RobotState.ONLINE: 2, RobotState.OFFLINE: 1, RobotState.TROUBLE: 1}
    assert found.live_cameras == 3
    assert found.rate_hz == 8.0
    assert found.robots(Wanted()) is found.robots(Wanted())
