import pytest

from gateway.process import warn_of_own_host
from gateway.settings import RosSettings

VARIABLES = ("ROS_HOSTNAME", "ROS_IP")


@pytest.mark.parametrize(
    ("environment", "given", "said"),
    [
        ({"ROS_IP": "192.0.2.1"}, {}, "ROS_IP 192.0.2.1: is not an address of this machine"),
        (
            {"ROS_HOSTNAME": "no-such-robot.invalid", "ROS_IP": "127.0.0.1"},
            {},
            "ROS_HOSTNAME no-such-robot.invalid: this machine tells other nodes to connect to a name that does not",
        ),
        ({"ROS_IP": "127.0.0.1"}, {"ros_host": "192.0.2.1"}, "--ros-host 192.0.2.1: is not an address of this"),
        ({"ROS_IP": "127.0.0.1"}, {}, ""),
    ],
)
async def test_a_host_that_nobody_can_reach_is_warned_of_with_where_it_is_from(
    environment: dict[str, str],
    given: dict[str, str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    await warn_of_own_host(RosSettings.model_validate(given))
    assert [message[: len(said)] for message in caplog.messages] == ([said] if said else [])


def test_without_a_variable_the_host_is_the_machines_name(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    assert RosSettings().host_given_by() == "this machine's host name"
