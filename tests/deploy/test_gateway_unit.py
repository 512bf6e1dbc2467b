import shlex
from pathlib import Path

from gateway.settings import GatewaySettings
from services.toolbox.settings import load
from tests.deploy.units import DEPLOY, command, values


def settings(text: str, folder: Path) -> GatewaySettings:
    file = folder / "gateway.yaml"
    file.write_text(text, encoding="utf-8")
    return load(GatewaySettings, ["--config", str(file)], prog="fleetsight gateway").settings


def test_the_unit_starts_a_gateway_with_a_file_of_settings() -> None:
    (started,) = values("gateway", "ExecStart")
    program, name, *options = shlex.split(started)
    assert Path(program).name == "fleetsight"
    assert command(name).load_settings() is GatewaySettings
    assert options == ["--config", "/etc/fleetsight/gateway.yaml"]


def test_the_example_holds_settings_of_a_gateway(tmp_path: Path) -> None:
    text = (DEPLOY / "gateway.yaml").read_text(encoding="utf-8")
    found = settings(text, tmp_path)
    assert (found.robot, found.connect) == ("r1", ["tcp/central:7447"])
    said, _, on_a_thin_link = text.partition("# On a thin link:\n")
    thin = settings(said + on_a_thin_link.replace("# ", ""), tmp_path)
    assert (thin.max_hz_of("front/color"), thin.max_hz_of("front/depth")) == (10, 5)
    assert (thin.factor_of("front/color"), thin.factor_of("front/depth"), thin.uplink_mbit) == (2, 1, 8)
