"""Somebody who may not look any more sees the log-in, and finds again what they looked at; so after a restart."""

import re
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio
from nicegui import Client
from playwright.async_api import Browser, expect

from services.monitor.web.auth import middleware
from services.monitor.web.auth.users import Role
from services.toolbox.demo.children import free_ports
from tests.integration.page.browser import PATIENCE_MS, looking, open_browser
from tests.integration.page.tls_proxy import tls_proxy
from tests.integration.page.warehouse import Robot, warehouse
from tests.services.monitor.web.serving import PASSWORD, served

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def browser() -> AsyncIterator[Browser]:
    async with open_browser() as opened:
        yield opened


async def test_a_user_who_is_removed_while_they_look_through_a_proxy_is_sent_to_the_log_in(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(middleware, "LOOK_S", 0.05)  # so that their socket is closed before their page can be told
    port = free_ports(2)
    behind = port + 1
    async with (
        tls_proxy(tmp_path, port, behind),
        warehouse(web_port=behind, web_url=f"https://localhost:{port}") as fleet,
        served(fleet.monitor) as at,
        looking(browser, at, tmp_path) as looker,
    ):
        fleet.enter(Robot("r1", {"box": 2}))
        page = await looker.go("/in-view")
        await expect(page.locator("[data-sighting='r1/front/box']")).to_be_visible()
        await at.remove(Role.OPERATOR)
        await page.wait_for_url(re.compile(r"/login\?next=/in-view"))
        await expect(page.get_by_label("Password")).to_be_visible()


async def test_somebody_whose_session_ended_while_they_were_away_logs_in_and_is_where_they_were(
    browser: Browser, tmp_path: Path
) -> None:
    async with (
        warehouse() as fleet,
        served(fleet.monitor) as at,
        looking(browser, at, tmp_path) as looker,
    ):
        fleet.enter(Robot("r1", {"box": 2}))
        page = await looker.go("/health?search=r1")
        await page.context.set_offline(True)
        await expect(page.get_by_text("Connection lost")).to_be_visible()
        at.access.log_out(at.cookie[1])
        await page.context.set_offline(False)
        await page.wait_for_url("**/login?next=/health%3Fsearch%3Dr1")
        await page.get_by_label("Name").fill(Role.OPERATOR)
        await page.get_by_label("Password").fill(PASSWORD)
        await page.get_by_role("button", name="Log in").click()
        await page.wait_for_url("**/health?search=r1")
        await expect(page.locator("[data-gateway=r1]")).to_be_visible()


@pytest.mark.parametrize("path", ["/", "/in-view", "/health"])
async def test_a_search_survives_a_restart(browser: Browser, tmp_path: Path, path: str) -> None:
    rows = "[data-robot], [data-sighting], [data-gateway]"
    async with warehouse(web_port=free_ports(1)) as fleet:
        fleet.enter(Robot("r1", {"box": 2}))
        fleet.enter(Robot("r2", {"pallet": 1}))
        serving = served(fleet.monitor, folder=tmp_path)
        at = await serving.__aenter__()
        async with looking(browser, at, tmp_path) as looker:
            page = await looker.go(path)
            await expect(page.locator(rows)).to_have_count(2)
            await page.get_by_label("Search").fill("r2")
            await expect(page.locator(rows)).to_have_count(1)
            await page.wait_for_url("**/*search=r2*")
            await serving.__aexit__(None, None, None)
            for client in list(Client.instances.values()):
                client.delete()  # as when their process ends
            await expect(page.get_by_text("Connection lost")).to_be_visible()
            async with served(fleet.monitor, folder=tmp_path):
                await expect(page.get_by_text("Connection lost")).to_be_hidden()
                await expect(page.get_by_label("Search")).to_have_value("r2")
                await expect(page.locator(rows)).to_have_count(1)
                await page.get_by_label("Search").fill("nobody")
                await expect(page.get_by_text("Clear the search")).to_be_visible()
                await page.get_by_label("Search").fill("")
                await expect(page.locator(rows)).to_have_count(2)
