from pathlib import Path

import pytest
from pydantic import ValidationError

from services.monitor.settings import MonitorSettings


def test_the_monitor_is_the_router_on_this_machine_only_unless_told_otherwise() -> None:
    settings = MonitorSettings()
    assert (settings.mode, settings.listen, settings.connect) == ("router", ["tcp/127.0.0.1:7447"], [])


def test_it_can_be_a_client_of_another_router() -> None:
    assert MonitorSettings(mode="client").connect == ["tcp/127.0.0.1:7447"]
    settings = MonitorSettings(mode="client", connect=["tcp/central:7447"])
    assert (settings.listen, settings.connect) == ([], ["tcp/central:7447"])


@pytest.mark.parametrize("field", ["listen", "connect"])
def test_a_wrong_endpoint_names_its_setting(field: str) -> None:
    with pytest.raises(ValidationError) as caught:
        MonitorSettings.model_validate({field: ["central:7447"]})
    assert caught.value.errors()[0]["loc"][0] == field


def test_zones_need_the_world_models(tmp_path: Path) -> None:
    zones = tmp_path / "zones.yaml"
    zones.write_text("zones: []", encoding="utf-8")
    assert MonitorSettings(zones=zones).follows_world
    assert not MonitorSettings(world="off").follows_world
    with pytest.raises(ValidationError, match="leave out --zones, or set --world on"):
        MonitorSettings(world="off", zones=zones)


def test_a_warehouse_reports_to_its_centre_by_name() -> None:
    settings = MonitorSettings(warehouse="berlin", centre=["tcp/hq:7447"], lease_s=4)
    bus = settings.centre_bus()
    assert (bus.mode, bus.connect, bus.listen, bus.lease_s) == ("client", ["tcp/hq:7447"], [], 4)
    for wrong, why in (
        ({"warehouse": "berlin"}, "centre: --centre and --warehouse go together"),
        ({"centre": ["tcp/hq:7447"]}, "warehouse: --centre and --warehouse go together"),
        ({"centre": ["tcp/hq:7447"], "warehouse": "a/b"}, "warehouse name 'a/b'"),
        ({"centre": ["tls/hq:7447"], "warehouse": "berlin"}, "tls_ca: tls/ and quic/ endpoints need"),
    ):
        with pytest.raises(ValidationError, match=why):
            MonitorSettings.model_validate(wrong)


def test_the_centre_may_have_an_authority_of_its_own(tmp_path: Path) -> None:
    for folder, name in (("own", "central"), ("hq", "berlin")):
        (tmp_path / folder).mkdir()
        for file in ("ca.pem", f"{name}.pem", f"{name}.key"):
            (tmp_path / folder / file).touch()
    own, hq = tmp_path / "own", tmp_path / "hq"
    given = {"tls": own / "central", "warehouse": "berlin", "centre": ["tls/hq:7447"]}
    assert MonitorSettings.model_validate(given).centre_bus().tls_key == own / "central.key"
    settings = MonitorSettings.model_validate({**given, "centre_tls": hq / "berlin"})
    assert (settings.tls_ca, settings.centre_bus().tls_ca) == (own / "ca.pem", hq / "ca.pem")
    assert settings.centre_bus().tls_certificate == hq / "berlin.pem"
