"""Order of names, rounding, lines about problems."""

import pytest

from schemas.keys import CameraKey
from schemas.status import GatewayStatus, StreamStatus
from services.monitor.fleet import Fleet, problems_of
from services.monitor.formats import MAX_SHOWN, cameras_in_order, limited, natural, problem_lines


def test_names_are_sorted_as_people_count() -> None:
    assert sorted(["r10", "R2", "r1", "", "forklift-7", "r2a"], key=natural) == [
        "",
        "forklift-7",
        "r1",
        "R2",
        "r2a",
        "r10",
    ]


def test_cameras_are_sorted_by_robot_and_then_by_their_own_names() -> None:
    keys = [CameraKey(*name.split("/")) for name in ("r10/front", "r2/cam10", "r2/cam9", "r1/rear")]
    assert list(map(str, cameras_in_order(keys))) == ["r1/rear", "r2/cam9", "r2/cam10", "r10/front"]


def test_a_terminal_has_them_in_that_order() -> None:
    fleet = Fleet("clock")
    for name in ("r10", "r2", "r1"):
        fleet.robot_presence(name, alive=True)
        fleet.camera_presence(CameraKey(name, "front"), alive=True)
    assert [row.key.robot for row in fleet.rows(1.0)] == ["r1", "r2", "r10"]
    assert [row.key.robot for row in fleet.take_changed(1.0)] == ["r1", "r2", "r10"]
    assert problem_lines({"r10": ["waits"], "r2": ["waits"]}) == ["r2 waits", "r10 waits"]


def gateway(robot: str, *streams: StreamStatus, waiting_for: str = "") -> GatewayStatus:
    return GatewayStatus(
        robot=robot, boot_id="b", clock_id="c", sent_ns=0, waiting_for=waiting_for, streams=list(streams)
    )


def told(*gateways: GatewayStatus) -> list[str]:
    return problem_lines({each.robot: problems_of(each) for each in gateways})


def stream(problem: str, camera: str = "front", name: str = "color") -> StreamStatus:
    return StreamStatus(
        camera=camera, stream=name, topic="/t", wanted=True, publishers=0, received=0, forwarded=0, problem=problem
    )


def test_what_is_waited_for_and_wrong_by_robot() -> None:
    second = gateway("r2", stream(""), stream("unreachable"), stream("refused", camera="", name="tf"))
    first = gateway("r1", waiting_for="the ROS master at http://robot:11311")
    assert told(second, first, gateway("r3")) == [
        "r1 waits for the ROS master at http://robot:11311",
        "r2 front/color: unreachable",
        "r2 tf: refused",
    ]


@pytest.mark.parametrize(
    ("count", "shown"),
    [
        (MAX_SHOWN, ["x"] * MAX_SHOWN),
        (MAX_SHOWN + 1, [*["x"] * MAX_SHOWN, "and 1 more problem"]),
        (MAX_SHOWN + 2, [*["x"] * MAX_SHOWN, "and 2 more problems"]),
    ],
)
def test_the_rest_is_counted(count: int, shown: list[str]) -> None:
    assert limited(["x"] * count) == shown


def test_what_a_gateway_says_is_one_line() -> None:
    assert told(gateway("r1", stream("gone\n\x1b[2J"))) == [r"r1 front/color: gone\n\x1b[2J"]
