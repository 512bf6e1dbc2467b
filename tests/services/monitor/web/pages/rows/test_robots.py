import pytest

from services.monitor.liveness import ROBOT_SILENT_NS, RobotState
from services.monitor.web.pages.rows.robots import in_natural_order, standing
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
