"""The objects of a site on the page: a real world model over a real router, and somebody with a browser."""

import asyncio
import re
import threading
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from time import time_ns
from typing import Any

import msgspec
import pytest
import pytest_asyncio
from playwright.async_api import Browser, Locator, expect

from bus import QoS
from schemas import codec
from schemas.worker_keys import WorldStream, world_key
from schemas.world import ChangeKind, SiteStatus, WorldChange, WorldChanges, WorldObject
from services.monitor.fleet import Fleet
from services.monitor.map.drawing import ground_of
from services.monitor.map.footprints import DrawnObject, footprint
from services.monitor.monitor import Monitor
from services.monitor.process import running
from services.monitor.settings import MonitorSettings
from services.monitor.web.pages import map as map_page
from services.toolbox.demo.children import Child
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.page.browser import PATIENCE_MS, looking, open_browser
from tests.integration.page.sights import robot_on
from tests.integration.services.test_worldmodel import SITE, THINGS, Robots, start
from tests.services.monitor.web.serving import Served, served
from tests.services.monitor.world.test_site_status import status as site_status
from tests.waiting import PATIENCE_S, until

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)

ZONES = """
zones:
  - {name: near, site: hall-2, corners: [[3, -2], [4, -2], [4, 2], [3, 2]]}
"""
RULES = """
rules:
  - {name: what left, when: leaves, class: box, site: hall-2, zone: near, within_s: 600}
"""
NOTE_CHANGES = """([name, part]) => {
  window.changes = {...window.changes, [name]: 0};
  new MutationObserver(() => window.changes[name]++)
    .observe(document.querySelector(part), {childList: true, subtree: true, characterData: true, attributes: true});
}"""
BOX_OF = "polygon => { const box = polygon.getBBox(); return [box.width, box.height]; }"


@dataclass
class Site:
    """A site whose world model runs, and the browser to look at it with. looking: ends what robots see."""

    central: FleetRig
    robots: Robots
    views: AsyncExitStack
    model: Child
    monitor: Monitor
    at: Served
    browser: Browser

    def objects(self, name: str = "box") -> list[WorldObject]:
        """Return the objects of a class that the monitor knows, from west to east."""
        site = self.monitor.fleet.world.sites[SITE]
        return sorted((each.of for each in site.objects.values() if each.name == name), key=lambda of: of.at)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def site(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    (folder / "zones.yaml").write_text(ZONES, encoding="utf-8")
    history = f"sqlite:///{folder / 'history.db'}"
    (folder / "rules.yaml").write_text(RULES, encoding="utf-8")
    robots = Robots(THINGS)
    async with AsyncExitStack() as stack:
        central = await stack.enter_async_context(fleet_rig())
        views = await stack.enter_async_context(AsyncExitStack())
        await views.enter_async_context(robots.looking(central.bus))
        await stack.enter_async_context(robot_on(central.bus, "r1"))
        model = await start(central, "w1", "--refresh-s", "1")
        settings = MonitorSettings(
            mode="client",
            connect=[central.endpoint],
            zones=folder / "zones.yaml",
            rules=folder / "rules.yaml",
            history=history,
            web_port=0,
        )
        monitor = await stack.enter_async_context(running(settings, central.bus, Fleet("clock")))
        at = await stack.enter_async_context(served(monitor))
        browser = await stack.enter_async_context(open_browser())
        made = Site(central, robots, views, model, monitor, at, browser)
        await until(lambda: SITE in monitor.fleet.world.sites and len(made.objects()) == 2 and made.objects("pallet"))
        yield made


async def size_of(polygon: Locator) -> tuple[float, float]:
    """Return its width and height once it has some: a map that is drawn anew has none for a moment."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            width, height = await polygon.evaluate(BOX_OF)
            if width and height:
                return float(width), float(height)
            await asyncio.sleep(0.05)


async def test_objects_are_drawn_at_their_size_once_and_lead_to_their_pages(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .things polygon")).to_have_count(3)
        await expect(page.locator(".fs-map .robot.live")).to_have_count(1)
        await expect(page.locator(".fs-map .seen")).to_have_count(0)
        await expect(page.get_by_role("status")).to_be_hidden()
        await expect(page.get_by_text("Zone near: 1 box, 1 pallet")).to_be_visible()
        (pallet,) = site.objects("pallet")
        link = page.locator(f'.fs-map a[href="/world/{SITE}/{pallet.id}"]')
        await expect(page.locator(".fs-map .zone polygon")).to_be_visible()
        zone_width, _ = await size_of(page.locator(".fs-map .zone polygon"))  # a metre wide
        xs, ys = zip(*footprint(pallet), strict=True)
        expected = max(xs) - min(xs), max(ys) - min(ys)
        assert [side / zone_width for side in await size_of(link.locator("polygon"))] == pytest.approx(
            expected, abs=0.03
        )
        assert sorted(pallet.size)[1:] == pytest.approx([0.8, 1.2], abs=0.25)
        await page.get_by_role("combobox", name="Class").click()
        await page.get_by_role("option", name="pallet").click()
        await expect(page.locator(".fs-map .things polygon")).to_have_count(1)
        await looker.picture("world-map-desk-light")
        await link.click()
        await expect(page).to_have_url(re.compile(f"/world/{SITE}/{pallet.id}$"))
        await expect(page.get_by_text(f"pallet {pallet.id}", exact=True)).to_be_visible()


async def test_a_class_that_is_chosen_while_the_map_is_drawn_is_shown_next(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draws, chosen = threading.Event(), threading.Event()

    def held_up(*given: Any, objects: Sequence[DrawnObject], **more: Any) -> str:
        if len(objects) == 1:
            draws.set()
            chosen.wait(PATIENCE_S)
        return ground_of(*given, objects=objects, **more)

    monkeypatch.setattr(map_page, "ground_of", held_up)
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .things polygon")).to_have_count(3)
        for name in ("pallet", "box"):
            await page.get_by_role("combobox", name="Class").click()
            await page.get_by_role("option", name=name).click()
            await asyncio.to_thread(draws.wait, PATIENCE_S)
        await asyncio.sleep(0.5)  # until the server has heard of the second choice
        chosen.set()
        await expect(page.locator(".fs-map .things polygon")).to_have_count(2)


async def test_the_map_shows_when_the_floor_was_looked_at(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .things polygon")).to_have_count(3)
        layer = page.locator(".fs-map image")
        await expect(layer).to_have_count(0)
        await page.get_by_role("checkbox", name="When the floor was looked at").click()
        await expect(layer).to_have_count(1)
        await expect(page.get_by_text(re.compile("m² of floor that was looked at: .*within a minute"))).to_be_visible()
        width, height = await layer.evaluate("image => [image.width.baseVal.value, image.height.baseVal.value]")
        assert width > 0
        assert height > 0
        await page.get_by_role("checkbox", name="When the floor was looked at").click()
        await expect(layer).to_have_count(0)


async def test_an_object_has_a_page_with_its_facts_its_picture_and_what_became_of_it(
    site: Site, tmp_path: Path
) -> None:
    near, _ = site.objects()
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go(f"/world/{SITE}/{near.id}")
        facts = page.locator(".fs-facts")
        for said in ("box", "3.5", "near", "0.4", "r1/front", "r2/front", "now", "probable"):
            await expect(facts).to_contain_text(said)
        await page.wait_for_function("document.querySelector('.fs-picture').naturalWidth === 320")
        await expect(page.get_by_text("In view of")).to_be_visible()
        await expect(page.locator("[data-event=appeared]")).to_contain_text("at 3.5, -1.0 m, as r")
        await looker.picture("object-desk-light")
        await page.get_by_role("link", name="On the map").click()
        await expect(page.locator(".fs-map a.chosen")).to_have_attribute("href", f"/world/{SITE}/{near.id}")
        await looker.go(f"/world/{SITE}/{near.id}")
        site.robots.things = [thing for thing in THINGS if (thing.x, thing.y) != (3.5, -1.0)]
        await expect(page.get_by_text(f"box {near.id} is gone")).to_be_visible()
        await expect(page.locator("[data-event=gone]")).to_contain_text("from 3.5, -1.0 m")
        await looker.picture("object-gone-desk-light")
        await looker.go("/alerts")
        alert = page.locator("[data-alert]", has_text=f"box {near.id} left {SITE}/near")
        await expect(alert.get_by_role("link", name=near.id)).to_have_attribute("href", f"/world/{SITE}/{near.id}")
        await alert.get_by_role("link", name=near.id).click()
        site.robots.things = THINGS
        await expect(page.locator("[data-event=back]")).to_be_visible()
        await expect(page.locator(".fs-facts")).to_be_visible()


async def test_the_inventory_is_what_is_in_the_warehouse_by_class_and_zone(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/inventory")
        stock = page.locator("[data-stock]")
        await expect(stock).to_have_count(4)
        await expect(page.locator(f"[data-stock='{SITE}//box']")).to_contain_text("2")
        await expect(page.locator(f"[data-stock='{SITE}/near/box']")).to_contain_text("1")
        await expect(page.locator("[data-object]")).to_have_count(3)
        await expect(page.get_by_text("Over time: all classes, whole site")).to_be_visible()
        await expect(page.locator(".fs-chart canvas").first).to_be_visible(timeout=30_000)
        await looker.picture("inventory-desk-light")
        async with page.expect_download() as download:
            await page.get_by_role("link", name="Last day as CSV").click()
        text = await asyncio.to_thread(Path.read_text, await (await download.value).path(), "utf-8")
        assert f"{SITE},near,box," in text
        await page.locator("button.fs-tile", has_text="pallet").click()
        await expect(page.locator("[data-object]")).to_have_count(1)
        await expect(page.get_by_text("Objects: pallet, whole site")).to_be_visible()
        async with page.expect_download() as download:
            await page.get_by_role("link", name="Objects as CSV").click()
        text = await asyncio.to_thread(Path.read_text, await (await download.value).path(), "utf-8")
        (pallet,) = site.objects("pallet")
        assert [line.split(",")[:3] for line in text.splitlines()[1:]] == [[SITE, pallet.id, "pallet"]]
        await page.get_by_role("button", name="Whole site").click()
        await expect(page.locator("[data-object]")).to_have_count(3)
        await page.locator(f"[data-stock='{SITE}/near/box']").get_by_role("button").click()
        near = site.objects()[0]
        await expect(page.locator("[data-object]")).to_have_count(1)  # of several, the next line fails at once
        await expect(page.locator("[data-object]")).to_have_attribute("data-object", near.id)
        await expect(page).to_have_url(re.compile("class=box&zone=near"))
        await page.reload()
        await expect(page.locator("[data-object]")).to_have_count(1)
        await page.get_by_label("Search").fill("nothing like it")
        await expect(page.get_by_text("0 objects")).to_be_visible()
        await page.get_by_label("Search").fill("R2")
        await page.locator("[data-object] a").click()
        await expect(page.get_by_text(f"box {near.id}", exact=True)).to_be_visible()
        await looker.go("/inventory")
        await page.get_by_role("link", name="In view of cameras").click()
        await expect(page.locator("[data-sighting='r1/front/box']")).to_be_visible()
        await page.get_by_role("link", name="Whole site").click()
        await expect(page.locator("[data-object]")).to_have_count(3)


async def test_the_address_of_a_site_s_inventory_can_be_opened_again(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go(f"/inventory?site={SITE}")
        await expect(page.get_by_role("heading", name="By class and zone")).to_be_visible()
        await page.reload()
        await expect(page.get_by_role("heading", name="By class and zone")).to_be_visible()


async def test_an_unknown_object_and_an_unknown_site_are_answered_clearly(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go(f"/world/{SITE}/zz99")
        await expect(page.get_by_text("There is no such object")).to_be_visible()
        await expect(page.get_by_text(f"Site {SITE} has no object zz99")).to_be_visible()
        other = site.objects()[-1]
        merged = msgspec.structs.replace(other, id="mm")
        change = WorldChange(kind=ChangeKind.MERGED, at_ns=time_ns(), object=merged, into=other.id)
        site.monitor.fleet.world.sites[SITE]._events.append(change)
        await looker.go(f"/world/{SITE}/mm")
        await expect(page.get_by_text(f"It turned out to be {other.id}")).to_be_visible()
        await page.locator(".fs-empty").get_by_role("link", name=other.id).click()
        await expect(page.get_by_text(f"box {other.id}", exact=True)).to_be_visible()
        await looker.go("/world/nowhere/1")
        await expect(page.get_by_text(f"Known sites: {SITE}.")).to_be_visible()
        html = "<b onclick=x>"
        await looker.go(f"/world/{SITE}/{html}")
        await expect(page.get_by_text(html, exact=False).first).to_be_visible()
        assert await page.locator("b[onclick]").count() == 0


async def test_a_map_on_which_only_robots_move_does_not_draw_its_objects_again(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .things polygon")).to_have_count(3)
        await site.views.aclose()  # no robot looks any more
        for name, part in {"ground": ".fs-map > :first-child", "over": ".fs-over", "list": ".fs-scroll"}.items():
            await page.evaluate(NOTE_CHANGES, [name, part])
        async with asyncio.timeout(60):
            while True:  # until what was still on its way is drawn
                await page.evaluate("window.changes = {ground: 0, over: 0, list: 0}")
                await page.wait_for_function("window.changes.over > 3")
                if await page.evaluate("[window.changes.ground, window.changes.list]") == [0, 0]:
                    break


async def test_once_the_world_model_ends_that_is_said_with_the_cure(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .things polygon")).to_have_count(3)
        site.model.process.terminate()
        await site.model.process.wait()
        await expect(page.get_by_text("its objects are as they were then")).to_be_visible()
        await expect(page.locator(".fs-map .age4 polygon")).to_have_count(3)
        known = site.monitor.fleet.sites.of(SITE)
        assert known is not None
        site.monitor.fleet.sites.take(known.status, known.received_ns - 61 * 10**9)
        await expect(page.get_by_text("fleetsight worldmodel --connect")).to_be_visible()
        await expect(page.locator(".fs-map .things polygon")).to_have_count(0)
        await expect(page.locator(".fs-map .seen.fresh").first).to_be_visible()
        await looker.picture("map-without-model-desk-light")


async def test_with_the_world_off_nothing_of_it_is_subscribed_and_the_page_says_views_only(tmp_path: Path) -> None:
    settings = MonitorSettings(world="off", history="none", web_port=0)
    async with fleet_rig() as central, robot_on(central.bus, "r1"), AsyncExitStack() as stack:
        told = [
            await stack.enter_async_context(
                central.bus.publisher(world_key(SITE, each), QoS.RESULT, encoding=codec.encoding(schema))
            )
            for each, schema in ((WorldStream.STATUS, SiteStatus), (WorldStream.CHANGES, WorldChanges))
        ]
        monitor = await stack.enter_async_context(running(settings, central.bus, Fleet("clock")))
        at, browser = await stack.enter_async_context(served(monitor)), await stack.enter_async_context(open_browser())
        told[0].put(codec.encode(site_status(SITE, box=1)))
        async with looking(browser, at, tmp_path) as looker:
            page = await looker.go("/map")
            await expect(page.get_by_text("Views only: this monitor was started with --world off")).to_be_visible()
            await expect(page.locator(".fs-map .seen.fresh").first).to_be_visible()
            await looker.go("/inventory")
            await expect(page.get_by_text("Views only")).to_be_visible()
            await looker.go(f"/world/{SITE}/1")
            await expect(page.get_by_text("This monitor follows no world model")).to_be_visible()
        assert not any(each.wanted for each in told)
        assert not monitor.fleet.world.sites
