import shlex
from pathlib import Path

import pytest

from gateway.settings import GatewaySettings
from gateway.shaping.consumers import stays_near
from services.cloud.settings import CloudSettings
from services.distance.settings import DistanceSettings
from services.toolbox.commands import COMMANDS
from services.toolbox.settings import S, load

DEPLOY = Path(__file__).parents[2] / "deploy"


def started(unit: str) -> list[str]:
    lines = (DEPLOY / unit).read_text(encoding="utf-8").splitlines()
    (command,) = (line.partition("=")[2] for line in lines if line.startswith("ExecStart="))
    return shlex.split(command)


@pytest.mark.parametrize(("service", "model"), [("distance", DistanceSettings), ("cloud", CloudSettings)])
def test_the_unit_starts_what_measures_beside_the_gateway_for_its_robot_alone(
    service: str, model: type[DistanceSettings | CloudSettings]
) -> None:
    assert started("fleetsight-space@.service")[1:] == ["%i", "--config", "/etc/fleetsight/space.yaml"]
    (command,) = (each for each in COMMANDS if each.name == service)
    assert command.load_settings() is model
    gateway, found = _example(GatewaySettings, "gateway.yaml"), _example(model, "space.yaml")
    assert found.robots == [gateway.robot]
    assert found.connect == gateway.listen
    assert stays_near(gateway)


def _example(model: type[S], name: str) -> S:
    return load(model, ["--config", str(DEPLOY / name)], prog="fleetsight").settings


def test_both_units_are_confined_alike() -> None:
    gateway, space = (
        (DEPLOY / name).read_text(encoding="utf-8").partition("NoNewPrivileges=")[2]
        for name in ("fleetsight-gateway.service", "fleetsight-space@.service")
    )
    assert gateway == space != ""


@pytest.mark.parametrize("unit", ["fleetsight-gateway.service", "fleetsight-space@.service"])
def test_both_ends_of_what_is_shared_on_a_robot_may_lock_it(unit: str) -> None:
    assert "LimitMEMLOCK=infinity" in (DEPLOY / unit).read_text(encoding="utf-8").splitlines()
