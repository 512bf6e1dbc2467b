import shlex
from pathlib import Path

import pytest

from gateway.settings import GatewaySettings
from services.detector.settings import DetectorSettings
from services.monitor.settings import MonitorSettings, UsersSettings
from services.toolbox.settings import load
from services.worldmodel.settings import WorldSettings
from tests.deploy.support.units import command, example, unit, values


@pytest.fixture(autouse=True)
def _a_service_s_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FLEETSIGHT_HISTORY", "FLEETSIGHT_CACHE"):
        monkeypatch.delenv(name)


@pytest.mark.parametrize(
    ("name", "model"),
    [("monitor", MonitorSettings), ("detector", DetectorSettings), ("worldmodel", WorldSettings)],
)
def test_the_unit_starts_its_service_with_a_file_of_settings(
    name: str, model: type[MonitorSettings | DetectorSettings | WorldSettings]
) -> None:
    (started,) = values(name, "ExecStart")
    assert shlex.split(started)[1:] == [name, "--config", f"/etc/fleetsight/{name}.yaml"]
    assert command(name).load_settings() is model
    assert isinstance(example(model, f"{name}.yaml"), model)


def test_robots_and_workers_connect_to_where_the_monitor_listens() -> None:
    (listening,) = example(MonitorSettings, "monitor.yaml").listen
    for connecting in (example(DetectorSettings, "detector.yaml"), example(GatewaySettings, "gateway.yaml")):
        assert connecting.connect == [f"tls/central:{listening.rpartition(':')[2]}"]
    assert listening.startswith("tls/")


def test_the_history_is_where_the_monitor_may_write_and_its_first_user_is_made_there() -> None:
    history = example(MonitorSettings, "monitor.yaml").history
    (folder,) = values("monitor", "StateDirectory")
    assert history == f"sqlite:////var/lib/{folder}/history.db"
    told = " ".join(line.lstrip("# ").rstrip("\\") for line in unit("monitor") if line.startswith("#   "))
    words = shlex.split(told[told.index("fleetsight users ") :])
    users = load(UsersSettings, command("users").options_of(words[2:]), prog="fleetsight users").settings
    assert (users.task, users.role, users.history) == ("add", "operator", history)


def test_the_world_is_kept_where_its_model_may_write() -> None:
    settings = example(WorldSettings, "worldmodel.yaml")
    (folder,) = values("worldmodel", "StateDirectory")
    assert settings.state == Path("/var/lib") / folder
    (listening,) = example(MonitorSettings, "monitor.yaml").listen
    assert [endpoint.rpartition(":")[2] for endpoint in settings.connect] == [listening.rpartition(":")[2]]


def test_what_the_detector_exports_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    (variable,) = values("detector", "Environment")
    monkeypatch.setenv(*variable.split("="))
    (folder,) = values("detector", "CacheDirectory")
    assert example(DetectorSettings, "detector.yaml").cache == Path("/var/cache") / folder
