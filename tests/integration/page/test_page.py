"""The monitor's page as people use it: real clicks in a real browser, over a real bus."""

import asyncio
import re
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import pytest_asyncio
from playwright.async_api import Browser, expect

from bus.fake import FakeNetwork
from services.monitor.web.auth.users import Role
from tests.integration.page.browser import PATIENCE_MS, looking, open_browser
from tests.integration.page.warehouse import Robot, Warehouse, warehouse
from tests.services.monitor.web.serving import Served, monitor_on, served

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)

NOTE_CHIPS = """() => {
  window.chips = [];
  const note = () =>
    document.querySelectorAll("[data-robot=r6] .fs-chip").forEach(chip => chips.push(chip.textContent));
  new MutationObserver(note).observe(document.body, {childList: true, subtree: true, characterData: true});
}"""

HTML = "<img src=x onerror=document.title=1>"

RULES = """
rules:
  - {name: nobody in the aisle, when: over, class: person, count: 0, severity: critical}
  - {name: boxes to move, when: over, class: box, count: 1, severity: info}
"""


@dataclass
class Site:
    """A fleet whose monitor is served, and the browser to look at it with."""

    fleet: Warehouse
    at: Served
    browser: Browser
    rules: Path


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def site(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Site]:
    """A warehouse with three robots; one class is called what would be HTML, and so is a robot."""
    folder = tmp_path_factory.mktemp("site")
    rules = folder / "rules.yaml"
    rules.write_text(RULES, encoding="utf-8")
    async with (
        warehouse(rules=rules, history=f"sqlite:///{folder}/history.db") as fleet,
        served(fleet.monitor) as at,
        open_browser() as browser,
    ):
        robots = [
            fleet.enter(Robot("r1", {"box": 2, "pallet": 1})),
            fleet.enter(Robot("r2", {HTML: 1})),
            fleet.enter(Robot("r10", {"person": 1}, waiting_for="a ROS master")),
        ]
        fleet.monitor.fleet.robot_presence(HTML, alive=True)
        fleet.serve(robots)
        yield Site(fleet, at, browser, rules)


async def test_the_fleet_is_seen_and_a_robot_that_goes_stays_on_screen_but_is_not_available(
    site: Site, tmp_path: Path
) -> None:
    site.fleet.enter(Robot("r3", {"pallet": 4}))
    async with looking(site.browser, site.at, tmp_path, size="wall") as looker:
        page = await looker.go("/")
        row = page.locator("[data-robot=r3]")
        await expect(row).to_contain_text("online")
        await expect(row).to_contain_text("4pallet")
        await site.fleet.leave("r3")
        await expect(row).to_contain_text("offline")
        await expect(row).to_contain_text("ago")
        await expect(row.locator(".fs-stale .fs-chip")).to_have_text("4pallet")
        await expect(page.locator("[data-robot=r10]")).to_contain_text("waits for a ROS master")
        await expect(page.locator("[data-robot=r2]")).to_contain_text(HTML)
        await expect(page.locator(".fs-name", has_text=HTML)).to_be_visible()
        assert await page.locator("img").count() == 0
        await looker.picture("fleet-wall-light")


async def test_what_flickers_and_what_is_not_there_is_not_on_the_first_page(site: Site, tmp_path: Path) -> None:
    robot = site.fleet.enter(Robot("r6", {"drum": 1, "tarp": 0}, flickers={"ghost": 1}))
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/")
        chips = page.locator("[data-robot=r6] .fs-chip")
        await expect(chips).to_have_text(["1drum"])
        await page.evaluate(NOTE_CHIPS)
        robot.seen = {"drum": 2, "tarp": 0}
        await expect(chips).to_have_text(["2drum"])
        robot.seen = {"drum": 2, "tarp": 0, "rack": 1}
        await expect(chips).to_have_text(["2drum", "1rack"])
        assert set(await page.evaluate("window.chips")) <= {"1drum", "2drum", "1rack"}
    await site.fleet.leave("r6")


async def test_robots_are_searched_and_chosen_by_their_state(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path, size="phone", scheme="dark") as looker:
        page = await looker.go("/")
        await page.get_by_label("Search").fill("box")
        await expect(page.locator("[data-robot]")).to_have_count(1)
        await expect(page.locator("[data-robot=r1]")).to_be_visible()
        await page.get_by_label("Search").fill("")
        await page.locator("button.fs-tile", has_text="Trouble").click()
        await expect(page.locator("[data-robot]")).to_have_count(1)
        await expect(page.locator("[data-robot=r10]")).to_be_visible()
        await looker.picture("fleet-phone-dark")
        await page.locator(".fs-footer").get_by_role("link", name="Inventory").click()
        await expect(page.get_by_text("The contents of the warehouse are not known")).to_be_visible()
        await page.get_by_role("link", name="In view of cameras").click()
        await expect(page.locator("[data-sighting='r1/front/box']")).to_contain_text("2.12 m")
        wide = await page.evaluate("document.documentElement.scrollWidth")
        assert wide == 375
        assert await page.locator("img").count() == 0
        await looker.picture("inventory-phone-dark")


async def test_what_was_in_view_is_listed_charted_and_downloaded(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path, scheme="dark") as looker:
        page = await looker.go("/in-view")
        row = page.locator("[data-sighting='r1/front/box']")
        await expect(row).to_contain_text("88%")
        await expect(row).to_contain_text("gpu-1 warehouse-n-seg")
        await row.get_by_role("button", name="box").click()
        await expect(page.get_by_text("In view: box, r1/front")).to_be_visible()
        await expect(page.locator(".fs-chart canvas").first).to_be_visible()
        await expect(page.get_by_text("that two cameras see counts twice")).to_be_hidden()
        await page.locator("button.fs-tile", has_text="box").click()
        await expect(page.locator("[data-sighting]")).to_have_count(1)
        async with page.expect_download() as download:
            await page.get_by_role("button", name="CSV").click()
        text = await asyncio.to_thread(Path.read_text, await (await download.value).path(), "utf-8")
        assert [line.split(",")[:4] for line in text.splitlines()[1:]] == [["r1", "front", "box", "2"]]
        async with page.expect_download() as download:
            await page.get_by_role("link", name="Last day as CSV").click()
        text = await asyncio.to_thread(Path.read_text, await (await download.value).path(), "utf-8")
        assert "r1,front,box," in text
        await page.get_by_label("Search").fill("r1")
        await expect(page.get_by_text("In view: box, whole fleet, with r1 in a name")).to_be_visible()
        await expect(page.locator(".fs-chart canvas").first).to_be_visible()
        await page.get_by_label("Search").fill("nowhere")
        await expect(page.get_by_text("None of it was in view during this time.")).to_be_visible()
        await page.get_by_label("Search").fill("")
        await expect(page.get_by_text("In view: box, whole fleet", exact=True)).to_be_visible()
        await looker.picture("inventory-desk-dark")


async def test_what_a_lost_robot_saw_is_not_in_view_now_but_is_not_forgotten(site: Site, tmp_path: Path) -> None:
    site.fleet.enter(Robot("r4", {"drum": 2}))
    async with looking(site.browser, site.at, tmp_path, size="wall") as looker:
        page = await looker.go("/in-view")
        row = page.locator("[data-sighting='r4/front/drum']")
        await expect(row).to_be_visible()
        other = site.fleet.enter(Robot("r7", {"drum": 1}))
        drums = page.locator("button.fs-tile", has_text="drum")
        await expect(drums).to_contain_text("3in 2 views")
        await expect(page.get_by_text("that two cameras see counts twice")).to_be_visible()
        await site.fleet.leave(other.key.robot)
        await expect(drums).to_have_text("drum2")
        await site.fleet.leave("r4")
        await expect(row).to_have_count(0)
        await expect(page.get_by_text("more currently unknown")).to_be_visible()
        await page.locator(".q-toggle", has_text="In view now").click()
        await expect(row).to_have_class(re.compile("fs-stale"))
        await looker.picture("inventory-wall-light")


async def test_an_alert_is_acknowledged_escalated_and_resolved_by_somebody(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/alerts")
        first = page.locator("[data-alert]").first
        await expect(first).to_contain_text("nobody in the aisle")
        await expect(first).to_contain_text("r10/front")
        await expect(page.get_by_text("1-2 of 2")).to_be_visible()
        await looker.picture("alerts-desk-light")
        await first.get_by_role("button", name="acknowledge").click()
        who = (await page.locator(".fs-who .fs-name").inner_text()).strip()
        await expect(first).to_contain_text(f"acknowledged by {who}")
        await first.get_by_role("button", name="escalate").click()
        await expect(first).to_contain_text(f"escalated by {who}")
        await first.get_by_role("button", name="resolve").click()
        question = page.get_by_role("dialog")
        await expect(question).to_contain_text("Resolve: 1 person in view of r10/front, over 0?")
        await question.get_by_role("button", name="Keep it open").click()
        await expect(question).to_be_hidden()
        await expect(first).to_contain_text("escalated by")
        await first.get_by_role("button", name="resolve").click()
        await looker.picture("resolve-desk-light")
        await question.get_by_role("button", name="Resolve").click()
        await expect(first).to_contain_text("boxes to move")
        ended = page.locator(".fs-panel", has_text="Resolved").last.locator("[data-alert]")
        await expect(ended).to_contain_text(f"resolved by {who}")


async def test_an_alert_of_a_robot_that_is_gone_says_that_it_is_not_of_now(site: Site, tmp_path: Path) -> None:
    site.fleet.enter(Robot("r5", {"box": 3}))
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/alerts")
        row = page.locator("[data-alert]", has_text="r5/front, over 1")
        await expect(row).to_be_visible()
        await expect(row).not_to_have_class(re.compile("fs-stale"))
        await site.fleet.leave("r5")
        await expect(row).to_have_class(re.compile("fs-stale"))
        await expect(row).to_contain_text("not known now: r5 is offline, last seen")
        current = page.locator("[data-alert]", has_text="r1/front, over 1")
        await expect(current).not_to_have_class(re.compile("fs-stale"))
        await looker.picture("alerts-gone-desk-light")
        await row.get_by_role("button", name="resolve").click()
        await page.get_by_role("dialog").get_by_role("button", name="Resolve").click()
        await expect(page.locator("tr", has_text="r5/front, over 1")).to_contain_text("resolved by")
        await expect(row).not_to_have_class(re.compile("fs-stale"))


async def test_health_says_who_serves_what_and_what_is_wrong_with_the_monitor(site: Site, tmp_path: Path) -> None:
    await asyncio.to_thread(site.rules.write_text, "rules:\n  - {name: x, when: sometimes}\n", "utf-8")
    async with looking(site.browser, site.at, tmp_path, size="wall", scheme="dark") as looker:
        page = await looker.go("/health")
        await expect(page.locator("[data-worker='detector/gpu-1']")).to_contain_text("r1/front")
        await expect(page.locator("[data-worker='detector/gpu-1']")).to_contain_text("version 0.8")
        await expect(page.locator("[data-gateway=r1]")).to_contain_text("version 0.9")
        await expect(page.locator("[data-gateway=r1]")).to_contain_text("/front/color/image_raw")
        await expect(page.locator("[data-gateway=r1]")).to_contain_text("detector/gpu-1")
        await expect(page.locator(".fs-banners")).to_contain_text("rules.yaml: line 2: rule 1: `when` is one of")
        await looker.picture("health-wall-dark")
    await asyncio.to_thread(site.rules.write_text, RULES, "utf-8")


async def test_a_history_that_is_not_kept_is_said_until_it_is_kept_again(site: Site, tmp_path: Path) -> None:
    (tmp_path / "new").write_text("in the way")
    async with (
        warehouse(history=f"sqlite:///{tmp_path}/new/history.db") as fleet,
        served(fleet.monitor) as at,
        looking(site.browser, at, tmp_path, size="phone") as looker,
    ):
        page = await looker.go("/")
        await expect(page.locator(".fs-banner", has_text="history is not being kept: ")).to_be_visible()
        await looker.picture("not-kept-phone-light")
        await asyncio.to_thread((tmp_path / "new").unlink)
        await expect(page.locator(".fs-banner:visible")).to_have_count(0)


async def test_a_robot_that_is_gone_for_good_is_forgotten_by_an_operator(site: Site, tmp_path: Path) -> None:
    async with (
        warehouse(history=f"sqlite:///{tmp_path}/history.db") as fleet,
        served(fleet.monitor) as at,
        looking(site.browser, at, tmp_path, size="phone") as looker,
    ):
        for name in ("r1", "r2"):
            fleet.enter(Robot(name, {"box": 1}))
        page = await looker.go("/")
        card, forget = page.locator("[data-robot=r1]"), page.get_by_role("button", name="forget r1")
        await expect(card).to_contain_text("online")
        await expect(forget).to_have_count(0)
        for name in ("r1", "r2"):
            await fleet.leave(name)
        await forget.click()
        question = page.get_by_role("dialog")
        await expect(question).to_contain_text("Forget r1?")
        await looker.picture("forget-phone-light")
        await question.get_by_role("button", name="Keep it").click()
        await expect(question).to_be_hidden()
        await expect(card).to_contain_text("offline")
        await forget.click()
        await question.get_by_role("button", name="Forget").click()
        await expect(card).to_have_count(0)
        await expect(page.locator("[data-robot=r2]")).to_contain_text("offline")
        fleet.enter(Robot("r1", {"box": 1}))
        await expect(card).to_contain_text("online")


async def test_a_monitor_that_cannot_hear_the_fleet_says_so(site: Site, tmp_path: Path) -> None:
    async with FakeNetwork().open_bus() as bus:
        deaf = monitor_on(bus)
    async with served(deaf) as at, looking(site.browser, at, tmp_path, scheme="dark") as looker:
        page = await looker.go("/")
        await expect(page.locator(".fs-banner.fs-bad")).to_contain_text("The fleet cannot be heard")
        await expect(page.locator(".fs-banner.fs-bad")).to_contain_text("the bus is closed")
        await looker.picture("deaf-desk-dark")


async def test_who_may_only_look_sees_alerts_but_no_buttons(site: Site, tmp_path: Path) -> None:
    async with (
        served(site.fleet.monitor, Role.VIEWER) as at,
        looking(site.browser, at, tmp_path, size="phone") as looker,
    ):
        page = await looker.go("/alerts")
        await expect(page.locator("[data-alert]").first).to_contain_text("boxes to move")
        assert await page.get_by_role("button", name="resolve").count() == 0
        await site.fleet.leave("r2")
        await looker.go("/")
        await expect(page.locator("[data-robot=r2]")).to_contain_text("offline")
        assert await page.get_by_role("button", name="forget").count() == 0
        await looker.picture("alerts-phone-light")


async def test_the_theme_that_somebody_chose_is_kept_and_they_can_log_out(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/health")
        await expect(page.locator("body.body--light")).to_be_attached()
        for _ in ("light", "dark"):
            await page.get_by_label("Theme").click()
        await page.wait_for_function("document.cookie.includes('fleetsight-theme=dark')")
        await looker.go("/")
        await expect(page.locator("body.body--dark")).to_be_attached()
        await page.get_by_label("Log out").click()
        await page.wait_for_url("**/login")


async def test_an_empty_fleet_says_what_to_do_and_a_monitor_that_goes_greys_the_page(
    site: Site, tmp_path: Path
) -> None:
    async with warehouse() as empty:
        serving = served(empty.monitor)
        at = await serving.__aenter__()
        async with looking(site.browser, at, tmp_path) as looker:
            page = await looker.go("/")
            await expect(page.get_by_text("fleetsight gateway --robot r1 --connect")).to_be_visible()
            await looker.picture("empty-desk-light")
            await serving.__aexit__(None, None, None)
            await expect(page.get_by_text("Connection lost")).to_be_visible()
            await looker.picture("lost-desk-light")
