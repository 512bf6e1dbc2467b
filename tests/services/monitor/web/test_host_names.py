"""The host names under which browsers may open the page: a foreign one could lead to us (DNS rebinding)."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import ValidationError

from bus.fake import FakeNetwork
from services.monitor.settings import MonitorSettings
from services.monitor.web import process
from services.monitor.web.application import place_of
from services.monitor.web.auth.users import Role
from services.monitor.web.process import machine_names
from tests.services.monitor.web.asking import Web
from tests.services.monitor.web.serving import monitor_on, served


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({}, set()),
        ({"web_host": "0.0.0.0"}, {"0.0.0.0"}),  # noqa: S104 - a name like any other here
        ({"web_url": "https://Fleet.Example"}, {"fleet.example"}),
        ({"web_host_names": ["Fleet.LAN.", "fleet"]}, {"fleet.lan", "fleet"}),
        ({"web_host": "central.lan"}, {"central.lan"}),
    ],
)
def test_settings_and_the_machine_say_which_names_are_ours(given: dict[str, Any], names: set[str]) -> None:
    hosts = place_of(MonitorSettings.model_validate(given), frozenset({"central"})).hosts
    assert {"localhost", "central"} | names <= hosts <= {"localhost", "central", "127.0.0.1"} | names


@pytest.mark.parametrize("name", ["http://fleet.lan", "fleet.lan:8080", "fleet.lan/", "", "*", "a b", "-x"])
def test_what_is_no_host_name_is_refused_with_an_example(name: str) -> None:
    with pytest.raises(ValidationError, match="is no host name; give one without scheme, port and path"):
        MonitorSettings.model_validate({"web_host_names": [name]})


async def test_the_machine_is_known_by_its_own_name_with_and_without_its_domain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "Central")
    monkeypatch.setattr(socket, "getfqdn", lambda name: f"{name}.warehouse.example.")
    assert await machine_names() == {"central", "central.local", "central.warehouse.example"}


async def test_a_name_server_that_does_not_answer_keeps_no_page_from_being_served(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "central")
    monkeypatch.setattr(process, "NAMES_S", 0.0)
    assert {"central", "central.local"} <= await machine_names()


async def test_a_browser_sent_to_us_under_a_foreign_name_gets_nothing_and_the_cure(web: Web) -> None:
    async with await web.browser() as browser:
        assert (await browser.get("/api/v1/me")).status_code == 200
        for path in ("/", "/login", "/api/v1/me", "/metrics", "/setup"):
            answer = await browser.get(path, headers={"Host": "evil.test:8080"})
            assert answer.status_code == 421, path
            assert (
                "unknown host name evil.test; if it is this monitor's, start it with --web-host-names evil.test"
                in (answer.json()["error"])
            )
        odd = await browser.get("/", headers={"Host": "<script>"})
        assert (odd.status_code, odd.json()) == (421, {"error": "the request names no host of this monitor"})
    async with web.stranger() as probe:
        for host in ("10.1.2.3:8080", "fleet-monitor:8080", "evil.test"):
            assert (await probe.get("/healthz", headers={"Host": host})).status_code == 200
        assert (await probe.get("/login", headers={"Host": "10.1.2.3:8080"})).status_code == 200
    async with await web.program(Role.VIEWER) as prometheus:
        for path in ("/metrics", "/healthz"):
            assert (await prometheus.get(path, headers={"Host": "fleet-monitor.fleet.svc:8080"})).status_code == 200


async def test_a_monitor_for_other_machines_checks_names_too(tmp_path: Path) -> None:
    everywhere = "0.0.0.0"  # noqa: S104 - for other machines
    async with (
        FakeNetwork().open_bus() as bus,
        served(monitor_on(bus, web_host=everywhere, web_host_names=["fleet.lan"]), folder=tmp_path) as at,
    ):
        port = at.url.rpartition(":")[2]
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=60) as stranger:
            codes = {
                host: (await stranger.get("/login", headers={"Host": host})).status_code
                for host in ("evil.test", "fleet.lan", f"127.0.0.1:{port}", "192.168.0.10")
            }
    assert codes == {"evil.test": 421, "fleet.lan": 200, f"127.0.0.1:{port}": 200, "192.168.0.10": 200}


def test_over_its_own_https_the_certificate_names_the_hosts(tmp_path: Path) -> None:
    for name in ("page.pem", "page.key"):
        (tmp_path / name).touch()
    settings = MonitorSettings(web_certificate=tmp_path / "page.pem", web_key=tmp_path / "page.key")
    assert place_of(settings).hosts == frozenset()
