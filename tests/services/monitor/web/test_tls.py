"""The page over HTTPS with a certificate of its own."""

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import httpx
import pytest
from nicegui import app as nicegui_app

from bus import BusError
from bus.fake import FakeNetwork
from services.monitor.settings import MonitorSettings
from services.monitor.web import process
from services.monitor.web.application import cookie_of
from services.monitor.web.process import Web
from tests.bus.certificates import certificate, make_certificates
from tests.services.monitor.web.serving import monitor_on
from tests.waiting import until

HSTS = "strict-transport-security"


def files(folder: Path, host: str = "central") -> dict[str, Path]:
    of = certificate(folder, host)
    return {"web_certificate": of["tls_certificate"], "web_key": of["tls_key"]}


@asynccontextmanager
async def served(folder: Path) -> AsyncIterator[Web]:
    make_certificates(folder)
    nicegui_app.middleware_stack = None  # the page's application outlives each server of this process
    nicegui_app.user_middleware.clear()
    async with FakeNetwork().open_bus() as bus:
        given = files(folder)
        monitor = monitor_on(
            bus,
            history=f"sqlite:///{folder / 'history.db'}",
            web_certificate=given["web_certificate"],
            web_key=given["web_key"],
        )
        web = Web.of(monitor.settings)
        running = asyncio.create_task(web.run(monitor))
        try:
            yield web
        finally:
            running.cancel()
            with suppress(asyncio.CancelledError):
                await running


def certificate_at(url: httpx.URL) -> str:
    assert url.port is not None
    return ssl.get_server_certificate((url.host, url.port))


async def test_browsers_come_by_https_alone(tmp_path: Path) -> None:
    async with served(tmp_path) as web, asyncio.timeout(60):
        assert web.url.startswith("https://127.0.0.1:")
        trusting = ssl.create_default_context(cafile=str(tmp_path / "ca.pem"))
        async with httpx.AsyncClient(base_url=web.url, verify=trusting, timeout=30) as browser:
            health = await browser.get("/healthz")
            assert (health.status_code, health.headers[HSTS]) == (200, "max-age=86400")
            page = await browser.get("/")
            assert (page.status_code, page.headers[HSTS]) == (303, "max-age=86400")
        async with httpx.AsyncClient(base_url=web.url.replace("https", "http"), timeout=30) as plain:
            with pytest.raises(httpx.TransportError):
                await plain.get("/healthz")
        async with httpx.AsyncClient(base_url=web.url, timeout=30) as stranger:
            with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
                await stranger.get("/healthz")


async def test_a_renewed_certificate_is_taken_and_a_damaged_one_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(process, "LOOKED_AT_S", 0.05)
    caplog.set_level("INFO", "services.monitor.web.process")
    async with served(tmp_path) as web, asyncio.timeout(60):
        url = httpx.URL(web.url)
        before = await asyncio.to_thread(certificate_at, url)
        kept = files(tmp_path)["web_certificate"].read_text()
        files(tmp_path)["web_certificate"].write_text("no certificate")
        await until(lambda: "no PEM certificate can be read from it; the page uses the previous" in caplog.text)
        assert await asyncio.to_thread(certificate_at, url) == before
        files(tmp_path)["web_certificate"].write_text(kept)
        make_certificates(tmp_path)
        await until(lambda: "the page's certificate has changed" in caplog.text)
        while await asyncio.to_thread(certificate_at, url) == before:  # noqa: ASYNC110 - the old one may be taken once more
            await asyncio.sleep(0.05)


def test_cookies_go_over_https_alone(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    assert cookie_of(MonitorSettings.model_validate(files(tmp_path))) == "__Host-fleetsight"


def test_files_that_cannot_be_used_are_refused_at_the_start(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    own, other = files(tmp_path), files(tmp_path, "gpu1")
    with pytest.raises(ValueError, match="web_key: HTTPS needs a certificate and its key, and one is given; give both"):
        MonitorSettings.model_validate({"web_certificate": own["web_certificate"]})
    with pytest.raises(ValueError, match="web_url: with web_certificate the page is served over HTTPS"):
        MonitorSettings.model_validate({**own, "web_url": "http://fleet.example"})
    with pytest.raises(BusError, match=r"^web_key .*gpu1.key: does not belong to web_certificate .*central.pem$"):
        Web.of(MonitorSettings.model_validate({"web_port": 0, **own, "web_key": other["web_key"]}))
    own["web_key"].chmod(0o644)
    with pytest.raises(BusError, match=r"^web_key .*: everybody on this machine may read it; run chmod o="):
        Web.of(MonitorSettings.model_validate({"web_port": 0, **own}))
