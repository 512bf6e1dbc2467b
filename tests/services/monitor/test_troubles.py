import pytest

from schemas.status import GatewayStatus, StreamStatus
from services.monitor.fleet import problems_of
from services.monitor.formats import MAX_SHOWN, limited, problem_lines


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
