"""compose.yaml, compose.robots.yaml and the Containerfile, as they are written."""

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
                monkeypatch.setenv(setting, value.replace("${FLEETSIGHT_DB_PASSWORD:-fleetsight}", "fleetsight"))
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
                (DEPLOY.parent / Path(".containerignore")).read_text(encoding="utf-8").splitlines()
            )
