import pytest
from pydantic import ValidationError

from services.toolbox.call.settings import CallSettings


@pytest.mark.parametrize(("robot", "service"), [("r1", "reset"), ("r1", "/a b"), ("r/1", "/reset"), ("", "/reset")])
def test_a_call_names_a_robot_and_a_service(robot: str, service: str) -> None:
    with pytest.raises(ValidationError, match=r"not the name of a ROS service|robot name"):
        CallSettings(robot=robot, service=service)


@pytest.mark.parametrize("timeout_s", [0, 55.1])
def test_a_call_takes_so_long_at_most(timeout_s: float) -> None:
    with pytest.raises(ValidationError, match="timeout_s"):
        CallSettings(robot="r1", service="/reset", timeout_s=timeout_s)
