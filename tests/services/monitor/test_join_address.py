import socket

import pytest
from pydantic import ValidationError

from services.monitor.join_address import UNKNOWN, endpoint_to_join, endpoints_to_join, how_to_join, own_address
from services.monitor.settings import MonitorSettings


def told(**given: object) -> str:
    return endpoint_to_join(MonitorSettings.model_validate(given))


@pytest.mark.parametrize("listen", ["tcp/0.0.0.0:7448", "tcp/[::]:7448", "tcp/0.0.0.0:7448?rel=0"])
def test_who_listens_everywhere_names_an_address_that_can_be_connected_to(listen: str) -> None:
    endpoint = told(listen=[listen])
    host = endpoint.removeprefix("tcp/").removesuffix(":7448").strip("[]")
    assert host not in ("0.0.0.0", "::")  # noqa: S104 - on purpose
    with socket.create_server(("0.0.0.0", 0)) as server:  # noqa: S104 - on purpose
        socket.create_connection((host, server.getsockname()[1])).close()
    assert how_to_join(MonitorSettings(listen=[listen])) == f"gateways and detectors join with --connect {endpoint}"


def test_an_interface_that_is_named_is_the_one_that_is_told() -> None:
    assert told(listen=["tcp/0.0.0.0:7447#iface=lo"]) == "tcp/127.0.0.1:7447"
    assert own_address("nothing0") == socket.gethostname()


def test_an_address_that_others_reach_comes_before_this_machines_own() -> None:
    both = MonitorSettings(listen=["tcp/127.0.0.1:7447", "tcp/10.0.0.5:7447"])
    assert endpoints_to_join(both) == ["tcp/10.0.0.5:7447", "tcp/127.0.0.1:7447"]
    assert told() == "tcp/127.0.0.1:7447"
    assert told(mode="client", connect=["tcp/central:7447"]) == "tcp/central:7447"


def test_a_port_that_the_system_chooses_is_not_told() -> None:
    assert told(listen=["tcp/0.0.0.0:0"]) == UNKNOWN


def test_another_address_is_told_where_one_is_named() -> None:
    named = {"listen": ["tcp/0.0.0.0:7447"], "advertise": "tls/central.example:17447"}
    assert told(**named) == "tls/central.example:17447"
    assert endpoints_to_join(MonitorSettings.model_validate(named)) == ["tls/central.example:17447"]


@pytest.mark.parametrize(("listen", "wanted"), [("tcp/0.0.0.0:7447", False), ("tcp/[::]:7447", True)])
def test_an_address_is_of_a_family_that_is_listened_on(
    monkeypatch: pytest.MonkeyPatch, listen: str, *, wanted: bool
) -> None:
    class Six(socket.socket):
        """Of a machine whose only route to others is of IPv6, which none is in a test."""

        def connect(self, _address: object) -> None:
            if self.family == socket.AF_INET:
                raise OSError("Network is unreachable")

        def getsockname(self) -> tuple[str, int, int, int]:
            return "2001:db8::5", 1, 0, 0

    monkeypatch.setattr("services.monitor.join_address.socket.socket", Six)
    assert (told(listen=[listen]) == "tcp/[2001:db8::5]:7447") is wanted


@pytest.mark.parametrize(
    "wrong",
    ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/[::ffff:0.0.0.0]:7447", "tcp/central:0", "central:7447"],
)
def test_an_address_that_nobody_can_connect_to_is_refused(wrong: str) -> None:
    with pytest.raises(ValidationError) as caught:
        MonitorSettings.model_validate({"advertise": wrong})
    assert caught.value.errors()[0]["loc"] == ("advertise",)
