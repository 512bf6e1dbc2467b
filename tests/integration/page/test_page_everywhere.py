"""Every page of the monitor on the smallest and the largest screen, with a fleet and without one."""

import re
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import pytest_asyncio
from playwright.async_api import Browser, expect

from services.monitor.join_address import endpoint_to_join
from services.monitor.live_views import why_no_picture
from tests.integration.page.browser import PATIENCE_MS, SIZES, Size, looking, open_browser
from tests.integration.page.in_sight import out_of_sight
from tests.integration.page.touching import too_small_to_touch
from tests.integration.page.warehouse import Robot, Warehouse, warehouse
from tests.services.monitor.web.pages.rows.test_warehouses import report_of
from tests.services.monitor.web.serving import Served, served
from tests.services.monitor.world.test_site_objects import tell_of, thing

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)

LONG = "a-robot-whose-name-has-as-many-letters-as-a-name-may-have-there"
UNBROKEN = "x" * 63
RULES = """
rules:
  - {name: pallets that wait, when: over, class: pallet, count: 0, severity: critical}
  - {name: no box, when: under, class: box, count: 9}
"""
PAGES = {
    "/": f"[data-robot={LONG}]",
    "/inventory": "[data-object=a]",
    "/world/hall/a": ".fs-facts",
    "/in-view": "[data-sighting='r1/front/box']",
    "/alerts": f"[data-alert]:has-text('{LONG}')",
    "/health": "[data-worker='detector/gpu-1']",
    "/warehouses": f"[data-warehouse={LONG}]",
    f"/warehouses/{LONG}": ".fs-facts",
    "/map": ".fs-map .things a",
    "/cameras/r1/front": ".fs-row:has-text('box')",
    "/objects/r1/front": "text=No cloud runs",
    f"/cameras/{LONG}/{UNBROKEN}": ".fs-row:has-text('pallet')",
    f"/objects/{LONG}/{UNBROKEN}": "text=No cloud runs",
}
EMPTY = {
    "/": ("No robot has joined yet", "fleetsight gateway --robot r1 --connect"),
    "/inventory": ("The contents of the warehouse are not known", "fleetsight worldmodel --connect"),
    "/in-view": ("Nothing has been seen yet", "fleetsight detector --connect"),
    "/alerts": ("No open alerts", "--rules rules.yaml"),
    "/health": ("No worker has reported yet", "fleetsight"),
    "/warehouses": ("No warehouse reports here", "fleetsight monitor --warehouse NAME --centre"),
    "/map": ("No position is known yet", "fleetsight distance --connect"),
    "/cameras/r1/front": ("No camera r1/front is known", "fleetsight gateway --robot r1"),
    "/objects/r1/front": ("No camera r1/front is known", "fleetsight gateway --robot r1"),
}


@dataclass
class Site:
    """A monitor with a fleet, and the browser to look at it with."""

    fleet: Warehouse
    at: Served
    browser: Browser


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def browser() -> AsyncIterator[Browser]:
    async with open_browser() as opened:
        yield opened


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def site(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Site]:
    """A fleet with short names, and with the longest that there may be; alerts of all of them."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "rules.yaml").write_text(RULES, encoding="utf-8")
    async with (
        warehouse(rules=folder / "rules.yaml", history=f"sqlite:///{folder}/history.db") as fleet,
        served(fleet.monitor) as at,
    ):
        waiting_for = "a ROS master at http://somewhere-far-away.example:11311/"
        robots = [
            Robot("r1", {"box": 2, "pallet": 1, "a class with a long name " * 3: 1}),
            Robot(LONG, {"pallet": 1, "y" * 100: 1}, camera=UNBROKEN, waiting_for=waiting_for),
            Robot(UNBROKEN, {"box": 1}, camera=LONG),
        ]
        fleet.serve([fleet.enter(robot) for robot in robots])
        long = thing("y" * 64, 3, name="a class with a long name " * 3)
        tell_of(fleet.monitor.fleet, thing("a", 1), thing("b", 2, name="pallet"), long)
        for name in ("berlin", LONG):
            report_of(fleet.monitor.fleet, name, problems=["z" * 200], page=f"https://{'w' * 200}.example")
        yield Site(fleet, at, browser)


@pytest.mark.parametrize("size", SIZES)
async def test_nothing_on_any_page_is_cut_off_or_beyond_its_side(site: Site, tmp_path: Path, size: Size) -> None:
    async with looking(site.browser, site.at, tmp_path, size=size) as looker:
        for path, shown in PAGES.items():
            page = await looker.go(path)
            await expect(page.locator(shown).first).to_be_visible()
            wide = await page.evaluate("document.documentElement.scrollWidth")
            assert wide == SIZES[size][0], path
            assert not await out_of_sight(page), path


async def test_whatever_can_be_pressed_on_a_phone_is_large_enough_for_a_finger(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path, size="phone", scheme="dark") as looker:
        for path, shown in PAGES.items():
            page = await looker.go(path)
            await expect(page.locator(shown).first).to_be_visible()
            assert not await too_small_to_touch(page), path
        page = await looker.go("/alerts")
        await page.locator("[data-alert]").first.get_by_role("button", name="resolve").click()
        await expect(page.get_by_role("dialog").get_by_text("Resolve: ")).to_be_visible()
        await page.wait_for_function("document.getAnimations().length === 0")
        assert not await too_small_to_touch(page)
        assert not await out_of_sight(page)
        await looker.picture("resolve-phone-dark")


async def test_the_fleet_says_how_often_how_old_and_how_much_was_dropped(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/")
        row = page.locator("[data-robot=r1]")
        await expect(row).to_contain_text(re.compile(r"\d\.\d ?/s"))
        await expect(row).to_contain_text(re.compile(r"\d\.\d ?s"))
        dropped = row.locator("td").nth(-2)
        await expect(dropped).to_have_text(re.compile(r"[1-9]"))
        await dropped.locator("span").first.hover()
        await expect(page.get_by_text("gateway: more than anybody can use")).to_be_visible()


async def test_a_picture_that_does_not_come_for_long_is_a_case_for_health(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(why_no_picture, "FIRST_FRAME_TIMEOUT_S", 1.0)
    async with looking(site.browser, site.at, tmp_path, size="phone") as looker:
        page = await looker.go("/cameras/r1/front")
        said = "Check in Health that a detector serves r1/front without dropping its images"
        await expect(page.locator(".fs-reason")).to_contain_text(said)
        await looker.picture("camera-waits-phone-light")


async def test_an_empty_page_says_what_to_do(browser: Browser, tmp_path: Path) -> None:
    async with warehouse() as empty, served(empty.monitor) as at, looking(browser, at, tmp_path) as looker:
        for path, said in EMPTY.items():
            page = await looker.go(path)
            for text in said:
                await expect(page.get_by_text(text).first).to_be_visible()


@pytest.mark.parametrize("advertise", [None, "tls/central.example:17447"])
async def test_people_are_told_an_address_that_they_can_connect_to(
    browser: Browser, tmp_path: Path, advertise: str | None
) -> None:
    listens = {"listen": ["tcp/0.0.0.0:7447"], "advertise": advertise}
    async with warehouse(**listens) as empty, served(empty.monitor) as at, looking(browser, at, tmp_path) as looker:
        told = advertise or endpoint_to_join(empty.monitor.settings)
        for path in ("/", "/in-view", "/health", "/map", "/wall"):
            page = await looker.go(path)
            await expect(page.get_by_text(told).first).to_be_visible()
            assert "0.0.0.0" not in await page.locator("body").inner_text(), path  # noqa: S104 - nobody binds to it
