"""Every page of the monitor with axe-core, which looks for what keeps people out, and with the keyboard alone."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest
import pytest_asyncio
from axe_playwright_python.async_playwright import Axe
from playwright.async_api import Browser, Page, expect

from services.monitor.web.auth.routes import link_needed, log_in_form, notice, set_up_form
from tests.integration.page.browser import PATIENCE_MS, Scheme, Size, looking, open_browser
from tests.integration.page.sights import robot_on
from tests.integration.page.warehouse import Robot, Warehouse, warehouse
from tests.services.monitor.web.pages.rows.test_warehouses import report_of
from tests.services.monitor.web.serving import Served, served
from tests.services.monitor.world.test_site_objects import tell_of, thing

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)

SERIOUS: Final = ("serious", "critical")
"""What axe-core calls faults that keep somebody from using a page."""

SOFTWARE_GL: Final = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
RULES: Final = """
rules:
  - {name: pallets that wait, when: over, class: pallet, count: 0, severity: critical}
  - {name: no box, when: under, class: box, count: 9}
  - {name: who is here, when: over, class: person, count: 0, severity: info}
"""
PAGES: Final = {
    "/": "[data-robot=r2]",
    "/inventory": "[data-object=a]",
    "/world/hall/a": ".fs-facts",
    "/in-view": "[data-sighting='r2/front/pallet']",
    "/alerts": "[data-alert]:has-text('r2')",
    "/health": "[data-gateway=r2]",
    "/warehouses": "[data-warehouse=berlin]",
    "/warehouses/berlin?site=hall-2": ".fs-facts",
    "/map": ".fs-map .robot.live",
    "/cameras/r1/front": ".fs-picture:not(.fs-old)",
    "/cameras/r3/front": "text=r3 is offline",
    "/objects/r1/front": "button.fs-row",
    "/wall": ".fs-need",
}
LOOKS: Final[tuple[tuple[Size, Scheme], ...]] = (("desk", "light"), ("desk", "dark"), ("phone", "dark"))

COLOURS: Final = "each => [getComputedStyle(each).color, getComputedStyle(each).backgroundColor]"

HEADINGS: Final = """() => [document.documentElement.lang, document.querySelectorAll("h1").length]"""


@dataclass
class Site:
    """A monitor with something on each of its pages, and the browser to look at it with."""

    fleet: Warehouse
    at: Served
    browser: Browser


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def site(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Site]:
    """Robots: r1 can be seen live, r2 is in trouble, r3 is offline; r10 has a camera that nobody speaks for."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "rules.yaml").write_text(RULES, encoding="utf-8")
    async with (
        warehouse(rules=folder / "rules.yaml", history=f"sqlite:///{folder}/history.db") as fleet,
        robot_on(fleet.bus, "r1"),
        served(fleet.monitor) as at,
        open_browser(*SOFTWARE_GL) as browser,
    ):
        robots = [
            fleet.enter(Robot("r2", {"box": 2, "pallet": 1}, waiting_for="a ROS master")),
            fleet.enter(Robot("r10", {"person": 1})),
            fleet.enter(Robot("r3", {"box": 1})),
        ]
        fleet.serve(robots[:1])
        forklifts = [thing(f"f{number}", number, name="forklift") for number in range(12)]
        tell_of(fleet.monitor.fleet, thing("a", 1), *forklifts)
        report_of(fleet.monitor.fleet, "berlin")
        async with looking(browser, at, folder) as looker:
            page = await looker.go("/")
            await expect(page.locator("[data-robot=r3]")).to_contain_text("1box")
            robots[1].seen = None
            await fleet.leave("r3")
            await expect(page.locator("[data-robot=r10]")).to_contain_text("silent")
        yield Site(fleet, at, browser)


async def faults(page: Page, of: str = "", *, without: str = "") -> list[str]:
    """Return what axe-core finds that is serious, with where it is.

    of: a selector of what is looked at, else all. without: a rule that is left out.
    """
    rules = {without: {"enabled": False}} if without else {}
    found = await Axe().run(page, of or None, {"resultTypes": ["violations"], "rules": rules})
    return [
        f"{fault['id']}: {node['html'][:200]} ({node['failureSummary']})"
        for fault in found.response["violations"]
        for node in fault["nodes"]
        if fault["impact"] in SERIOUS
    ]


@pytest.mark.parametrize(("size", "scheme"), LOOKS)
async def test_nothing_on_any_page_keeps_anybody_out(site: Site, tmp_path: Path, size: Size, scheme: Scheme) -> None:
    found: dict[str, list[str]] = {}
    async with looking(site.browser, site.at, tmp_path, size=size, scheme=scheme) as looker:
        for path, shown in PAGES.items():
            page = await looker.go(path)
            await expect(page.locator(shown).first).to_be_visible()
            assert await page.evaluate(HEADINGS) == ["en-US", 1], path
            found[path] = await faults(page)
            await looker.picture(f"accessible{path.replace('/', '-')}-{size}-{scheme}")
    assert found == {path: [] for path in PAGES}


@pytest.mark.parametrize("scheme", ["light", "dark"])
async def test_nothing_keeps_anybody_from_logging_in(site: Site, tmp_path: Path, scheme: Scheme) -> None:
    forms = (
        log_in_form("/"),
        log_in_form("/", "wrong name or password"),
        set_up_form("secret"),
        link_needed(),
        notice("There is no such page", "The monitor has nothing at /nowhere."),
    )
    async with looking(site.browser, site.at, tmp_path, scheme=scheme) as looker:
        for form in forms:
            await looker.page.set_content(form)
            assert await faults(looker.page) == [], form


async def test_a_question_keeps_nobody_out(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path, scheme="dark") as looker:
        page = await looker.go("/alerts")
        await page.locator("[data-alert]").first.get_by_role("button", name="resolve").click()
        await expect(page.get_by_role("dialog").get_by_text("Resolve: ")).to_be_visible()
        await expect(page.locator("[class*=-enter-]")).to_have_count(0)  # it has faded in
        # The rest is behind it, out of reach. axe-core (4.12) takes its backdrop for what is behind a button's text.
        found = await faults(page, "[role=dialog]", without="color-contrast")
        assert not found, "\n".join(found)
        answer = page.get_by_role("dialog").get_by_role("button", name="Resolve")
        assert await answer.evaluate(COLOURS) == ["rgb(22, 29, 36)", "rgb(130, 174, 252)"], "dark on light"


async def test_a_table_is_sorted_by_keyboard_and_says_how(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/")
        heading = page.get_by_role("columnheader", name="Robot")
        names = page.locator("tbody .fs-name")
        await expect(page.get_by_role("columnheader", name="State")).to_have_attribute("aria-sort", "ascending")
        await expect(names).to_have_text(["r3", "r10", "r2", "r1"])
        await heading.get_by_role("button").focus()
        await page.keyboard.press("Enter")
        await expect(heading).to_have_attribute("aria-sort", "ascending")
        await expect(names).to_have_text(["r1", "r2", "r3", "r10"])
        await page.keyboard.press("Space")
        await expect(heading).to_have_attribute("aria-sort", "descending")
        await expect(names).to_have_text(["r10", "r3", "r2", "r1"])
        await expect(page.locator("[aria-sort]")).to_have_count(1)
        await expect(heading.get_by_role("button")).to_be_focused()


async def test_what_has_the_focus_keeps_it_while_rows_change(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/")
        row = page.locator("[data-robot=r2]")
        link = row.get_by_role("link", name="front")
        await link.focus()
        before = await row.inner_text()
        for _ in range(3):
            await page.wait_for_function(
                "([row, was]) => row.innerText !== was", arg=[await row.element_handle(), before]
            )
            before = await row.inner_text()
        await expect(link).to_be_focused()


async def test_how_many_rows_there_are_is_chosen_by_keyboard(site: Site, tmp_path: Path) -> None:
    more = [site.fleet.enter(Robot(f"r{number}", {"box": 1})) for number in range(20, 29)]
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/health")
        gateways = page.locator(".fs-panel", has=page.get_by_role("heading", name="Gateways"))
        await expect(gateways.get_by_text("1-13 of 13")).to_be_visible()
        await gateways.get_by_role("combobox", name="Rows per page").focus()
        await page.keyboard.press("Enter")
        await page.get_by_role("option", name="10", exact=True).click()
        await expect(gateways.get_by_text("1-10 of 13")).to_be_visible()
        await expect(page.get_by_role("listbox")).to_have_count(0)  # half closed, its children are no options
        assert await faults(page) == []
        await looker.picture("pages-desk-light")
        await gateways.get_by_role("button", name="Next page").click()
        await expect(gateways.get_by_text("11-13 of 13")).to_be_visible()
    await site.fleet.leave(*(robot.key.robot for robot in more))


async def test_a_long_list_is_scrolled_by_keyboard(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await page.set_viewport_size({"width": 1440, "height": 360})
        seen = page.get_by_role("region", name="Last seen")
        await expect(seen).to_contain_text("forklift")
        await seen.focus()
        await page.keyboard.press("End")
        await page.wait_for_function("document.querySelector('.fs-scroll').scrollTop > 0")
