"""A monitor with a model registry: errors of other parts, its problems, and what Health says of it."""

import asyncio
import time
from pathlib import Path

import pytest

from bus import BusSettings, open_bus
from schemas.models import ModelUse
from services.model_registry.client import use_model
from services.model_registry.folder import STATE_FILE
from services.model_registry.serving import serving_models
from services.monitor.fleet import Fleet
from services.monitor.process import run, running
from services.monitor.rules.loading import RuleFileError
from services.monitor.settings import MonitorSettings
from services.monitor.web.pages.health import MAX_NAMED, facts
from services.toolbox.demo.children import free_ports
from tests.services.model_registry.publishing import publish_file
from tests.services.monitor.web.serving import monitor_on
from tests.waiting import PATIENCE_S


def settings(folder: Path, **given: object) -> MonitorSettings:
    listen = [f"tcp/127.0.0.1:{free_ports(1)}"]
    fields = {"history": "none", "web": False, "listen": listen, "models": folder / "models", **given}
    return MonitorSettings.model_validate(fields)


async def test_a_bad_rule_file_is_the_same_error_with_a_registry(tmp_path: Path) -> None:
    (tmp_path / "rules.yaml").write_text("rules: 1")
    with pytest.raises(RuleFileError):
        async with asyncio.timeout(PATIENCE_S):
            await run(settings(tmp_path, rules=tmp_path / "rules.yaml"))


async def test_a_damaged_registry_is_a_problem_and_the_monitor_runs(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / STATE_FILE).write_bytes(b"")
    given = settings(tmp_path)
    async with (
        open_bus(given) as bus,
        serving_models(bus, tmp_path / "models") as models,
        running(given, bus, Fleet("clock"), models) as monitor,
    ):
        assert any("registry.json was damaged" in each for each in monitor.problems())


async def test_health_says_what_is_in_force_and_which_robots_have_a_canary(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with (
        open_bus(BusSettings(mode="router", listen=[endpoint])) as bus,
        open_bus(BusSettings(connect=[endpoint])) as other,
    ):
        monitor = monitor_on(bus)

        def told() -> str:
            return dict(facts(monitor, time.time_ns()))["Models"]

        assert told() == "not kept: started without --models"
        async with serving_models(bus, tmp_path / "models") as monitor.models:
            one, two = [await publish_file(other, tmp_path, each, each.decode()) for each in (b"one", b"two")]
            assert told() == "none is in force"
            await use_model(other, ModelUse(digest=one), PATIENCE_S)
            robots = [f"r{n}" for n in range(MAX_NAMED + 2)]
            await use_model(other, ModelUse(digest=two, robots=robots), PATIENCE_S)
            named = ", ".join(robots[:MAX_NAMED])
            assert told() == f"one@{one[:12]} is in force; canary two@{two[:12]} for {named} and 2 more"
        assert told() == "not served here"
