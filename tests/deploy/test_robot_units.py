"""The units of a robot: its gateway, and what measures beside it."""

import shlex
from pathlib import Path

import pytest

from gateway.settings import GatewaySettings
from gateway.to_bus.shaping.consumers import stays_near
from services.cloud.settings import CloudSettings
from services.distance.settings import DistanceSettings
from tests.deploy.support.units import DEPLOY, command, example, settings_of, values


def test_the_unit_starts_a_gateway_with_a_file_of_settings() -> None:
    (started,) = values("gateway", "ExecStart")
    program, name, *options = shlex.split(started)
    assert Path(program).name == "fleetsight"
    assert command(name).load_settings() is GatewaySettings
    assert options == ["--config", "/etc/fleetsight/gateway.yaml"]


def test_the_example_holds_settings_of_a_gateway() -> None:
    text = (DEPLOY / "gateway.yaml").read_text(encoding="utf-8")
    found = settings_of(GatewaySettings, text, "gateway.yaml")
    assert (found.robot, found.connect) == ("r1", ["tls/central:7447"])
    said, _, on_a_thin_link = text.partition("# On a thin link:\n")
    thin = settings_of(GatewaySettings, said + on_a_thin_link.replace("# ", ""), "gateway.yaml")
    assert (thin.max_hz_of("front/color"), thin.max_hz_of("front/depth")) == (10, 5)
    assert (thin.factor_of("front/color"), thin.factor_of("front/depth"), thin.uplink_mbit) == (2, 1, 8)


@pytest.mark.parametrize(("service", "model"), [("distance", DistanceSettings), ("cloud", CloudSettings)])
def test_the_unit_starts_what_measures_beside_the_gateway_for_its_robot_alone(
    service: str, model: type[DistanceSettings | CloudSettings]
) -> None:
    (started,) = values("space@", "ExecStart")
    assert shlex.split(started)[1:] == ["%i", "--config", "/etc/fleetsight/space.yaml"]
    assert command(service).load_settings() is model
    gateway, found = example(GatewaySettings, "gateway.yaml"), example(model, "space.yaml")
    assert found.robots == [gateway.robot]
    assert found.connect == gateway.listen
    assert stays_near(gateway)


@pytest.mark.parametrize("name", ["gateway", "space@"])
def test_both_ends_of_what_is_shared_on_a_robot_may_lock_it(name: str) -> None:
    assert values(name, "LimitMEMLOCK") == ["infinity"]
