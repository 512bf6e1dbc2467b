from pathlib import Path

import pytest

from bus import BusSettings, open_bus, zenoh_bus
from bus.session.probe import own_listeners, why_not_taken
from tests.bus.certificates import certificate, make_certificates
from tests.contract.conftest import free_endpoint


@pytest.mark.parametrize(
    ("listen", "probed"),
    [
        ("tcp/0.0.0.0:7447", ["tcp/127.0.0.1:7447"]),
        ("udp/[::]:7447", ["udp/[::1]:7447"]),
        ("tcp/192.0.2.1:7447", ["tcp/192.0.2.1:7447"]),
        ("tcp/0.0.0.0:0", []),
        ("tcp/0.0.0.0:7447#iface=eth0", []),
    ],
)
def test_a_process_connects_to_itself_where_it_listens(listen: str, probed: list[str]) -> None:
    assert own_listeners(BusSettings(mode="router", listen=[listen], connect=["tcp/192.0.2.2:7447"])) == probed


def test_who_scouts_for_anybody_does_not_find_itself() -> None:
    assert own_listeners(BusSettings(mode="peer", listen=["tcp/0.0.0.0:7447"], connect=[], scouting=True)) == []


async def test_a_router_takes_a_link_while_it_listens(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zenoh_bus, "CLOSE_DEADLINE_S", 30.0)  # a busy machine closes late, and says so
    endpoint = free_endpoint()
    settings = BusSettings(mode="router", listen=[endpoint], shared_memory=False)
    async with open_bus(settings):
        assert why_not_taken(settings, endpoint) == ""
    assert why_not_taken(settings, endpoint) != ""
    assert [record.message for record in caplog.records if record.levelname == "WARNING"] == []


async def test_a_router_with_a_certificate_for_another_name_takes_a_link_from_itself(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/127.0.0.2")  # of which no certificate speaks
    given = {"mode": "router", "listen": [endpoint], "shared_memory": False, **certificate(tmp_path, "r1")}
    settings = BusSettings.model_validate(given)
    async with open_bus(settings):
        assert why_not_taken(settings, endpoint) == ""
    assert why_not_taken(settings, endpoint) != ""
