"""Certificates and access rules that change while a process runs: it takes them without a restart."""

import asyncio
import json
import shutil
from pathlib import Path

import pytest

from bus import QUEUE, Bus, BusSettings, QoS, Subscription, open_bus
from bus.session import session
from tests.bus.certificates import certificate, make_certificates
from tests.bus.sessions import LEASE_S
from tests.contract.conftest import free_endpoint
from tests.waiting import next_of, until

KEY = "fleet/r1/text/hello"
CHANGED = "opening a new session: certificates or access rules have changed"


@pytest.fixture(autouse=True)
def looks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "LOOKED_AT_S", 0.1)


@pytest.fixture
def messages(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level("INFO", "bus.session.session")
    return caplog


def with_certificate(folder: Path, host: str, **settings: object) -> BusSettings:
    return BusSettings.model_validate({"lease_s": LEASE_S, **certificate(folder, host), **settings})


def rules(permission: str) -> str:
    return json.dumps({"enabled": True, "default_permission": permission, "rules": [], "subjects": [], "policies": []})


async def hears(heard: Subscription, bus: Bus, text: bytes) -> None:
    """Send until it is heard: what is sent while there is no link may be lost."""
    async with bus.publisher(KEY, QoS.RESULT) as hello:
        await until(lambda: not bus.link_problem)
        hello.put(text)
        while (await next_of(heard)).payload != text:
            pass


@pytest.mark.parametrize("host", ["central", "r1"])
async def test_a_renewed_certificate_is_taken(host: str, tmp_path: Path, messages: pytest.LogCaptureFixture) -> None:
    used, renewed = tmp_path / "used", tmp_path / "renewed"
    make_certificates(used)
    shutil.copytree(used, renewed)
    make_certificates(renewed)
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    async with (
        open_bus(with_certificate(used, "central", mode="router", listen=[endpoint])) as centre,
        centre.subscribe("fleet/**", QUEUE(9)) as heard,
        open_bus(with_certificate(used, "r1", connect=[endpoint])) as robot,
    ):
        await hears(heard, robot, b"before")
        assert CHANGED not in messages.text
        shutil.copy(certificate(renewed, host)["tls_certificate"], certificate(used, host)["tls_certificate"])
        await until(lambda: CHANGED in messages.text)
        await hears(heard, robot, b"after")


async def test_a_file_that_cannot_be_used_is_told_and_not_taken(
    tmp_path: Path, messages: pytest.LogCaptureFixture
) -> None:
    make_certificates(tmp_path)
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    file = certificate(tmp_path, "r1")["tls_certificate"]
    kept = tmp_path / "kept.pem"
    async with (
        open_bus(with_certificate(tmp_path, "central", mode="router", listen=[endpoint])) as centre,
        centre.subscribe("fleet/**", QUEUE(9)) as heard,
        open_bus(with_certificate(tmp_path, "r1", connect=[endpoint])) as robot,
    ):
        await hears(heard, robot, b"before")
        shutil.copy(file, kept)
        file.write_text("not a certificate")
        await until(
            lambda: (
                f"tls_certificate {file}: no PEM certificate can be read from it; the bus uses the previous"
                in messages.text
            )
        )
        await hears(heard, robot, b"still there")
        assert CHANGED not in messages.text
        shutil.copy(kept, file)
        await until(lambda: CHANGED in messages.text)
        await hears(heard, robot, b"mended")


async def test_a_router_takes_new_access_rules(tmp_path: Path, messages: pytest.LogCaptureFixture) -> None:
    make_certificates(tmp_path)
    endpoint = free_endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    access = tmp_path / "access.json"
    access.write_text(rules("deny"))
    settings = with_certificate(tmp_path, "central", mode="router", listen=[endpoint], access=access)
    async with (
        open_bus(settings) as centre,
        centre.subscribe("fleet/**", QUEUE(9)) as heard,
        open_bus(with_certificate(tmp_path, "r1", connect=[endpoint])) as robot,
        robot.publisher(KEY, QoS.RESULT) as hello,
    ):
        await until(lambda: not robot.link_problem)
        hello.put(b"denied")
        await asyncio.sleep(LEASE_S)
        assert heard.counts.received == 0
        access.write_text(rules("allow"))
        await until(lambda: CHANGED in messages.text)
        await hears(heard, robot, b"allowed")
