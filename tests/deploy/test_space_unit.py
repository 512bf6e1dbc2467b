import shlex

import pytest

from gateway.settings import GatewaySettings
from gateway.to_bus.shaping.consumers import stays_near
from services.cloud.settings import CloudSettings
from services.distance.settings import DistanceSettings
from tests.deploy.units import command, example, values


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
