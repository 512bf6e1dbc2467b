"""Somebody draws zones on the map with a browser."""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
import pytest_asyncio
from playwright.async_api import Browser, Page, expect

from bus.fake import FakeNetwork
from services.monitor.monitor import Monitor
from services.monitor.web.auth.users import Role
from services.monitor.world.zones import Zone, load_zones
from tests.integration.page.browser import PATIENCE_MS, looking, open_browser
from tests.services.monitor.web.serving import Served, monitor_on, served

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)

HALL = "zones:\n  - {name: hall, corners: [[-10, -5], [10, -5], [10, 5], [-10, 5]]}\n"


@dataclass
class Site:
    """A monitor with a zone file, and a browser. at: where operators look, and where viewers do."""

    file: Path
    monitor: Monitor
    browser: Browser
    at: Served

    def zones(self) -> dict[str, Zone]:
        return {each.name: each for each in load_zones(self.file)}


@pytest_asyncio.fixture(loop_scope="module")
async def site(tmp_path: Path) -> AsyncIterator[Site]:
    file = tmp_path / "zones.yaml"
    file.write_text(HALL, encoding="utf-8")
    async with AsyncExitStack() as stack:
        monitor = monitor_on(await stack.enter_async_context(FakeNetwork().open_bus()), zones=file)
        await monitor.zones.load()
        watching = asyncio.create_task(monitor.zones.watch())
        browser = await stack.enter_async_context(open_browser())
        yield Site(file, monitor, browser, await stack.enter_async_context(served(monitor)))
        watching.cancel()


async def click_at(page: Page, x: float, y: float) -> None:
    """Click at a place of the map, given in metres, in the hall of which the outline is drawn."""
    box = await page.locator(".fs-map .zone polygon").first.bounding_box()
    assert box is not None
    await page.mouse.click(box["x"] + (x + 10) / 20 * box["width"], box["y"] + (5 - y) / 10 * box["height"])


async def test_a_zone_is_drawn_changed_and_removed(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await page.get_by_role("button", name="Draw a zone").click()
        await page.get_by_label("Name").fill('dock "1"')
        await looker.picture("zone-begin-desk-light")
        corners = [(2.0, 1.0), (6.0, 1.0), (6.0, 4.0)]
        for count, corner in enumerate(corners, 1):
            await click_at(page, *corner)
            await expect(page.locator(".fleet-draft circle")).to_have_count(count)
        await looker.picture("zone-drawing-desk-light")
        await page.get_by_role("button", name="Save").click()
        await expect(page.locator(".fs-map .zone polygon")).to_have_count(2)
        await expect(page.locator(".fleet-draft")).to_have_count(0)
        drawn = site.zones()['dock "1"']
        assert drawn.site == "main"
        assert [each for corner in drawn.corners for each in corner] == pytest.approx(
            [each for corner in corners for each in corner], abs=0.1
        )
        await page.get_by_role("button", name="Change dock 1 of site main").click()
        await page.get_by_label("Name").fill("dock 2")
        await page.get_by_role("button", name="Undo the last corner").click()
        await page.get_by_role("button", name="Save").click()
        await expect(page.locator(".fs-notice[role=alert]")).to_have_text("corners: 2 corners: a zone needs at least 3")
        await page.get_by_label("Corners").fill("2, 1\n6; 1\n6, four")
        await page.get_by_role("button", name="Save").click()
        await expect(page.get_by_role("alert").filter(has_text="corner")).to_contain_text("'6, four' is no corner")
        await page.get_by_label("Corners").fill("2, 1\n6; 1\n6, 4.5")
        await page.get_by_role("button", name="Save").click()
        await expect(page.get_by_text("Zone dock 2")).to_be_visible()
        assert site.zones()["dock 2"].corners == ((2, 1), (6, 1), (6, 4.5))
        await page.get_by_role("button", name="Remove dock 2 of site main").click()
        await page.get_by_role("button", name="Keep").click()
        await page.get_by_role("button", name="Remove dock 2 of site main").click()
        await page.get_by_role("button", name="Remove", exact=True).click()
        await expect(page.locator(".fs-map .zone polygon")).to_have_count(1)
        assert set(site.zones()) == {"hall"}


async def test_clicks_are_no_corners_while_nobody_draws(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await click_at(page, 1, 1)
        await page.get_by_role("button", name="Draw a zone").click()
        await expect(page.get_by_label("Corners")).to_have_value("")
        await click_at(page, 1, 1)
        await expect(page.get_by_label("Corners")).to_have_value(re.compile(r"^(1|1\.0\d|0\.9\d), (1|1\.0\d|0\.9\d)$"))
        await page.get_by_role("button", name="Cancel").click()
        await click_at(page, 2, 2)
        await page.get_by_role("button", name="Draw a zone").click()
        await expect(page.get_by_label("Corners")).to_have_value("")


async def test_a_file_that_somebody_edits_is_shown_without_a_restart(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .zone polygon")).to_have_count(1)
        site.file.write_text(HALL + "  - {name: rack, corners: [[0, 0], [1, 0], [1, 1]]}\n", encoding="utf-8")
        await expect(page.locator(".fs-map .zone polygon")).to_have_count(2)
        await expect(page.get_by_role("button", name="Change rack of site main")).to_be_visible()


async def test_who_may_only_look_draws_nothing(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        monitor = monitor_on(await stack.enter_async_context(FakeNetwork().open_bus()))
        browser = await stack.enter_async_context(open_browser())
        at = await stack.enter_async_context(served(monitor, Role.VIEWER))
        async with looking(browser, at, tmp_path) as looker:
            page = await looker.go("/map")
            await expect(page.get_by_role("heading", name="Last seen")).to_be_visible()
            await expect(page.get_by_role("heading", name="Zones")).to_be_hidden()


async def test_without_a_file_it_is_said_how_to_have_one(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        monitor = monitor_on(await stack.enter_async_context(FakeNetwork().open_bus()))
        browser = await stack.enter_async_context(open_browser())
        at = await stack.enter_async_context(served(monitor))
        async with looking(browser, at, tmp_path) as looker:
            page = await looker.go("/map")
            await expect(page.get_by_text("start the monitor with --zones")).to_be_visible()
            await expect(page.get_by_role("button", name="Draw a zone")).to_be_hidden()
