"""The wall screen: read from across a hall, and nobody touches it."""

from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio
from playwright.async_api import Browser, expect

from bus.fake import FakeNetwork
from services.monitor.web.auth.users import Visitor
from services.monitor.web.pages import wall
from tests.integration.page.browser import PATIENCE_MS, looking, open_browser
from tests.integration.page.in_sight import out_of_sight
from tests.integration.page.warehouse import Robot, warehouse
from tests.services.monitor.web.serving import monitor_on, served
from tests.waiting import until

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)

RULES = """
rules:
  - {name: nobody in the aisle, when: over, class: person, count: 0, severity: critical}
  - {name: boxes to move, when: over, class: box, count: 1, severity: info}
"""
LONG = "a-robot-whose-name-has-as-many-letters-as-a-name-may-have-there"
MANY = 40

SMALLEST_PX = """() => Math.min(...[...document.querySelectorAll("body *")]
  .filter(each => each.checkVisibility({visibilityProperty: true, opacityProperty: true}))
  .filter(each => !each.closest("i, noscript"))
  .filter(each => [...each.childNodes].some(child => child.nodeType === Node.TEXT_NODE && child.textContent.trim()))
  .map(each => parseFloat(getComputedStyle(each).fontSize)))"""

SCROLLED = """() => [...document.querySelectorAll("*")].filter(each =>
  ["auto", "scroll"].includes(getComputedStyle(each).overflowY) && each.scrollHeight > each.clientHeight + 1).length
  + (document.documentElement.scrollHeight > innerHeight) + (document.documentElement.scrollWidth > innerWidth)"""

NOTE_ROBOTS = """() => {
  window.shown = new Set();
  const note = () => document.querySelectorAll("[data-robot]").forEach(each => shown.add(each.dataset.robot));
  new MutationObserver(note).observe(document.body, {childList: true, subtree: true});
  note();
}"""


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def browser() -> AsyncIterator[Browser]:
    async with open_browser() as opened:
        yield opened


async def test_what_needs_somebody_comes_first_and_all_robots_are_shown_in_turn_and_nobody_clicks(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wall, "TURN_S", 2.0)
    (tmp_path / "rules.yaml").write_text(RULES, encoding="utf-8")
    async with warehouse(rules=tmp_path / "rules.yaml") as fleet, served(fleet.monitor) as at:
        robots = [fleet.enter(Robot(f"shelf-{number}", {"box": 1, "pallet": 2})) for number in range(1, MANY)]
        robots.append(fleet.enter(Robot(LONG, {"person": 1}, waiting_for="a ROS master at http://far-away:11311/")))
        fleet.serve(robots)
        fleet.enter(Robot("lost1", {"box": 3}))
        async with looking(browser, at, tmp_path, size="wall", scheme="dark") as looker:
            page = await looker.go("/")
            await expect(page.locator("[data-robot=lost1]")).to_contain_text("online")
            await fleet.leave("lost1")
            await page.get_by_role("link", name="Wall screen").click()
            needs = page.locator(".fs-need")
            await expect(needs).to_have_count(2)
            await expect(needs.nth(0)).to_contain_text("1 person in view of")
            await expect(needs.nth(1)).to_contain_text("lost1: its gateway is gone")
            await page.evaluate(NOTE_ROBOTS)
            await page.wait_for_function(f"shown.size === {MANY}")
            await expect(page.locator("[data-robot=lost1]")).to_have_count(0)
            await expect(page.locator(".fs-figure", has_text="offline")).to_have_text("1offline")
            assert await page.evaluate(SMALLEST_PX) >= 22
            assert await page.evaluate(SCROLLED) == 0
            assert not await out_of_sight(page)
            await looker.picture("wall-dark")
            await page.set_viewport_size({"width": 3840, "height": 2160})
            assert await page.evaluate(SMALLEST_PX) >= 44
            await expect(page.locator(".fs-rest .fs-panel-head")).to_contain_text(f"of {MANY}")


async def test_where_nothing_is_wrong_and_where_nobody_is_that_is_said(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stayed: list[str] = []
    monkeypatch.setattr(Visitor, "stay", lambda visitor: stayed.append(visitor.name))
    async with (
        warehouse() as empty,
        served(empty.monitor) as at,
        looking(browser, at, tmp_path, size="wall") as looker,
    ):
        page = await looker.go("/wall")
        await expect(page.get_by_text("No robot has joined yet")).to_be_visible()
        await expect(page.get_by_text("No critical alert is open and no robot is offline or silent.")).to_be_visible()
        assert await page.evaluate(SMALLEST_PX) >= 22
        empty.enter(Robot("r1", {"box": 2}))
        await expect(page.locator("[data-robot=r1]")).to_contain_text("2 box")
        await expect(page.get_by_text("No robot has joined yet")).to_be_hidden()
        await looker.picture("wall-light")
        before = len(stayed)
        await until(lambda: len(stayed) > before + 1)


async def test_what_is_wrong_with_the_monitor_itself_is_said(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    async with FakeNetwork().open_bus() as bus:
        deaf = monitor_on(bus, history=f"sqlite:///{tmp_path}/taken")
    async with served(deaf) as at, looking(browser, at, tmp_path, size="wall") as looker:
        page = await looker.go("/wall")
        await expect(page.locator(".fs-banner.fs-bad")).to_contain_text("The fleet cannot be heard")
        await expect(page.get_by_text("Open alerts are unknown: ")).to_be_visible()
        await expect(page.get_by_text("No critical alert is open")).to_be_hidden()
        assert await page.evaluate(SMALLEST_PX) >= 22
        assert not await out_of_sight(page)
        await looker.picture("wall-deaf-light")
