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
