"""The files of compose and the Containerfile, as they are written."""

import re
from pathlib import Path

import pytest
import yaml

from deploy.release import images
from services.toolbox.settings import load
from tests.deploy.support.units import DEPLOY, command

PEERS = ("postgresql", "prometheus")


def test_each_service_of_compose_has_settings_that_its_command_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    services = yaml.safe_load((DEPLOY / "compose.yaml").read_text(encoding="utf-8"))["services"]
    monkeypatch.delenv("FLEETSIGHT_HISTORY", raising=False)
    for each, service in services.items():
        if each not in PEERS:
            name, *options = service["command"]
            for setting, value in service.get("environment", {}).items():
                monkeypatch.setenv(setting, re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", value))
            load(command(name).load_settings(), options, prog=f"fleetsight {name}")
        assert service["read_only"]
        assert service["cap_drop"] == ["ALL"]


def test_every_target_is_told_and_every_folder_that_is_copied_is_there() -> None:
    text = (DEPLOY / "Containerfile").read_text(encoding="utf-8")
    targets = [line.split()[-1] for line in text.splitlines() if line.startswith("FROM base AS")]
    assert sorted(targets) == sorted(name for name, extras in images(text).items() if extras)
    for line in text.splitlines():
        if line.startswith("COPY ") and "--from" not in line:
            assert all((DEPLOY.parent / name).exists() for name in line.split()[1:-1])
            assert {f"!{name}" for name in line.split()[1:-1]} <= set(
                (DEPLOY.parent / Path(".dockerignore")).read_text(encoding="utf-8").splitlines()
            )


def test_for_real_robots_every_process_but_a_robots_own_has_a_certificate() -> None:
    services = yaml.safe_load((DEPLOY / "compose.yaml").read_text(encoding="utf-8"))["services"]
    text = (DEPLOY / "compose.robots.yaml").read_text(encoding="utf-8").replace("!override ", "")
    secured = yaml.safe_load(text)["services"]
    ours = {name for name, service in services.items() if name not in PEERS and "profiles" not in service}
    assert secured.keys() == ours
    for name, service in secured.items():
        environment = service["environment"]
        folder = Path(environment["FLEETSIGHT_TLS"]).name
        assert f"/{folder}:/tls:ro" in "".join(service["volumes"])
        (endpoint,) = (environment[each] for each in ("FLEETSIGHT_CONNECT", "FLEETSIGHT_LISTEN") if each in environment)
        assert endpoint.startswith("tls/"), name
    assert secured["monitor"]["environment"]["FLEETSIGHT_INSECURE"] == "false"
