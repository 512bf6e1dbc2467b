"""Two warehouses and a centre: three routers, three monitors, two real world models, a browser at the centre."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
import pytest_asyncio
from playwright.async_api import Browser, expect
from pydantic import HttpUrl

from bus import QUEUE, Presence, QoS, Sample
from schemas import codec, worker_keys
from schemas.inventory import WarehouseReport
from services.monitor.fleet import Fleet
from services.monitor.monitor import Monitor
from services.monitor.process import running
from services.monitor.settings import MonitorSettings
from services.monitor.warehouses import reporting
from services.monitor.warehouses.reports import FRESH_NS
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.monitor.watching import always_seeing
from tests.integration.page.browser import PATIENCE_MS, looking, open_browser
from tests.integration.services.test_worldmodel import SITE, THINGS, Robots, start
from tests.services.monitor.web.serving import Served, served
from tests.waiting import until

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)

RULES = """
rules:
  - {name: a forklift, when: over, class: forklift, count: 0, severity: critical}
"""


@dataclass
class Centre:
    """A centre above two warehouses, Berlin and Lyon. heard: what else than reports came to its router.

    leaving: ends Lyon's monitor.
    """

    monitor: Monitor
    at: Served
    browser: Browser
    berlin: Monitor
    leaving: AsyncExitStack
    heard: list[str]

    async def answer(self, path: str, **query: Any) -> Any:
        """Return what the centre's API says."""
        async with httpx.AsyncClient(headers={"Authorization": f"Bearer {self.at.token}"}, timeout=60) as client:
            response = await client.get(f"{self.at.url}/api/v1/warehouses{path}", params=query)
            return response.raise_for_status().json()


@asynccontextmanager
async def warehouse(name: str, centre: FleetRig, folder: Path, seen: str) -> AsyncIterator[tuple[Monitor, FleetRig]]:
    """Run a warehouse: a router, a world model, a camera that sees something, and a monitor that reports."""
    (folder / "rules.yaml").write_text(RULES, encoding="utf-8")
    async with AsyncExitStack() as stack:
        rig = await stack.enter_async_context(fleet_rig())
        await stack.enter_async_context(Robots(THINGS if name == "berlin" else THINGS[:2]).looking(rig.bus))
        await start(rig, "w1", "--refresh-s", "1")
        await stack.enter_async_context(always_seeing(rig, seen))
        settings = MonitorSettings(
            mode="client",
            connect=[rig.endpoint],
            centre=[centre.endpoint],
            warehouse=name,
            web_url=HttpUrl(f"https://{name}.example"),
            rules=folder / "rules.yaml",
            history="none",
            web_port=0,
        )
        yield await stack.enter_async_context(running(settings, rig.bus, Fleet("clock"))), rig


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def centre(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Centre]:
    folder = tmp_path_factory.mktemp("centre")
    heard: list[str] = []
    async with AsyncExitStack() as stack:
        rig = await stack.enter_async_context(fleet_rig())
        leaving = await stack.enter_async_context(AsyncExitStack())
        spying = [asyncio.create_task(each) for each in (hear(rig, heard), watch(rig, heard))]
        stack.push_async_callback(ended, spying)
        settings = MonitorSettings(mode="client", connect=[rig.endpoint], history="none", web_port=0)
        monitor = await stack.enter_async_context(running(settings, rig.bus, Fleet("clock")))
        berlin, _ = await stack.enter_async_context(warehouse("berlin", rig, folder, "forklift"))
        await leaving.enter_async_context(warehouse("lyon", rig, folder, "box"))
        at = await stack.enter_async_context(served(monitor))
        browser = await stack.enter_async_context(open_browser())
        made = Centre(monitor, at, browser, berlin, leaving, heard)
        await until(lambda: [objects(made, name) for name in ("berlin", "lyon")] == [3, 2])
        yield made


async def hear(rig: FleetRig, heard: list[str]) -> None:
    """Note whatever comes from warehouses to the centre but their reports, as anybody there could."""
    async with rig.bus.subscribe("**", QUEUE(10_000)) as samples:
        async for sample in samples:
            note(sample, heard)


async def watch(rig: FleetRig, heard: list[str]) -> None:
    async with rig.bus.watch("**") as presences:
        async for presence in presences:
            note(presence, heard)


def note(what: Sample | Presence, heard: list[str]) -> None:
    if not what.key.startswith(("warehouses/", "services/monitor/")):  # the second: its own monitor's heartbeat
        heard.append(what.key)


async def ended(tasks: list[asyncio.Task[None]]) -> None:
    for task in tasks:
        task.cancel()
    for task in tasks:
        with suppress(asyncio.CancelledError):
            await task


def objects(centre: Centre, name: str) -> int:
    known = centre.monitor.fleet.warehouses.of(name)
    return 0 if known is None else sum(sum(site.objects.values()) for site in known.report.sites if site.current)


async def test_totals_and_alerts_of_every_warehouse_are_at_the_centre(centre: Centre) -> None:
    await until(lambda: (of := centre.monitor.fleet.warehouses.of("berlin")) is not None and of.report.open)
    berlin, lyon = (await centre.answer(""))["items"]
    assert (berlin["warehouse"], lyon["warehouse"]) == ("berlin", "lyon")
    assert berlin["objects"] == {"box": 2, "pallet": 1}
    assert lyon["objects"] == {"box": 1, "pallet": 1}
    assert (berlin["robots_online"], berlin["cameras_online"], berlin["page"]) == (1, 1, "https://berlin.example")
    assert (berlin["alerts"], lyon["alerts"]) == ({"critical": 1}, {})
    assert berlin["open_alerts"][0]["rule"] == "a forklift"
    assert berlin["in_view"] == {"forklift": 1}
    assert await centre.answer("/berlin") | {"last_report": 0} == berlin | {"last_report": 0}


async def test_objects_are_asked_of_the_warehouse(centre: Centre) -> None:
    page = await centre.answer("/berlin/objects", site=SITE, limit=2)
    rest = await centre.answer("/berlin/objects", site=SITE, after=page["next"])
    every = [*page["items"], *rest["items"]]
    there = centre.berlin.fleet.world.sites[SITE].objects
    assert [each["id"] for each in every] == sorted(there)
    pallets = (await centre.answer("/berlin/objects", **{"site": SITE, "class": "pallet"}))["items"]
    assert [(each["class"], each["site"]) for each in pallets] == [("pallet", SITE)]
    for path, query, status in (
        ("/berlin/objects", {"site": "nowhere"}, 404),
        ("/berlin/objects", {"site": "a/b"}, 502),
        ("/oslo", {}, 404),
        ("/oslo/objects", {"site": SITE}, 404),
    ):
        with pytest.raises(httpx.HTTPStatusError) as refused:
            await centre.answer(path, **query)
        assert refused.value.response.status_code == status


async def test_nothing_else_of_a_warehouse_leaves_it(centre: Centre) -> None:
    assert centre.berlin.fleet.class_lists > 0
    assert centre.heard == []


async def test_a_report_under_the_name_of_another_is_left_out(centre: Centre) -> None:
    known = centre.monitor.fleet.warehouses.of("berlin")
    assert known is not None
    before = centre.monitor.fleet.left_out["malformed messages"]
    key, encoding = worker_keys.warehouse_report("oslo"), codec.encoding(WarehouseReport)
    async with centre.monitor.bus.publisher(key, QoS.STATUS, encoding=encoding) as publisher:
        publisher.put(codec.encode(known.report))
        await until(lambda: centre.monitor.fleet.left_out["malformed messages"] > before)
    assert centre.monitor.fleet.warehouses.of("oslo") is None


async def test_a_report_that_cannot_be_made_ends_nothing_and_is_a_problem(
    centre: Centre, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as broken:
        broken.setattr(reporting, "report_of", None)
        await until(lambda: "no report can be made" in centre.berlin.centre.problem)
        assert any("no report can be made" in each for each in centre.berlin.problems())
    await until(lambda: not centre.berlin.centre.problem)
    lists = centre.berlin.fleet.class_lists
    await until(lambda: centre.berlin.fleet.class_lists > lists)


async def test_the_page_shows_them_and_which_of_them_is_silent(centre: Centre, tmp_path: Path) -> None:
    async with looking(centre.browser, centre.at, tmp_path) as looker:
        page = await looker.go("/")
        await page.locator(".fs-header .fs-nav").get_by_text("Warehouses").click()
        row = page.locator("[data-warehouse=berlin]")
        await expect(row).to_contain_text("2box")
        await expect(row).to_contain_text("1 critical")
        await expect(page.locator("[data-alert]")).to_contain_text("forklift")
        await looker.picture("warehouses")
        await row.get_by_role("link", name="berlin").click()
        await expect(page.get_by_role("link", name="https://berlin.example")).to_be_visible()
        await page.get_by_role("link", name=SITE).click()
        await expect(page.locator("[data-object]")).to_have_count(3)
        await looker.picture("warehouse")
        page = await looker.go("/warehouses/oslo")
        await expect(page.get_by_text("There is no such warehouse")).to_be_visible()

        await centre.leaving.aclose()
        await looker.go("/warehouses")
        silent = page.locator("[data-warehouse=lyon]")
        await expect(silent).to_contain_text("offline")
        await expect(page.locator("[data-warehouse=berlin]")).to_contain_text("online")
        await expect(page.locator(".fs-banner").first).to_contain_text("warehouse lyon has not reported for")
    lyon = await centre.answer("/lyon")
    assert not lyon["current"]
    assert lyon["objects"] == {"box": 1, "pallet": 1}, "as known last"
    async with httpx.AsyncClient(headers={"Authorization": f"Bearer {centre.at.token}"}, timeout=60) as client:
        metrics = (await client.get(f"{centre.at.url}/metrics")).text
    assert 'fleetsight_warehouse_up{warehouse="lyon"} 0.0' in metrics
    assert 'fleetsight_warehouse_objects{class="box",warehouse="berlin"} 2.0' in metrics
    assert 'fleetsight_warehouse_objects{class="box",warehouse="lyon"}' not in metrics
    assert FRESH_NS == 10e9
