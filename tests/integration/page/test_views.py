"""What people look at live, in a real browser: it is made while they look, and not longer."""

import asyncio
import io
import re
from base64 import b64encode
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import time_ns

import numpy as np
import pytest
import pytest_asyncio
from PIL import Image
from playwright.async_api import Browser, expect

from bus import Bus, QoS, Reply, Request
from bus.fake import FakeNetwork
from schemas import codec, keys
from schemas.detections import ClassCount, ClassList
from schemas.keys import CameraKey, Stream
from schemas.models import PictureRequest, SavedPicture
from services.monitor.map.drawing import Bounds, ground_of
from services.monitor.map.floor_plan import MOST_CELLS, FloorPlan, MapDescription, load_floor_plan
from services.monitor.monitor import Monitor
from services.monitor.process import watch_fleet
from services.monitor.web.pages.picture_frame import VIEW_STYLE
from services.monitor.world.site_objects import World
from services.simulator.floor_plan import write_floor_plan
from tests.integration.page.browser import PATIENCE_MS, looking, open_browser
from tests.integration.page.sights import Robot, robot_on
from tests.services.monitor.web.serving import Served, monitor_on, served
from tests.services.monitor.world.test_site_objects import DOCK, RACK, thing
from tests.services.monitor.world.test_site_status import status as site_status
from tests.waiting import until

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(300)]

expect.set_options(timeout=PATIENCE_MS)

SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
SIZE_OF_IMAGE = """url => new Promise((done, failed) => {
  const image = new Image();
  image.onload = () => done([image.naturalWidth, image.naturalHeight]);
  image.onerror = failed;
  image.src = url;
})"""
BOXES, MASKS, OBJECTS = "front/overlay/detection", "front/overlay/segmentation", "front/objects"


@dataclass
class Site:
    """A robot that somebody may look at."""

    robot: Robot
    bus: Bus
    monitor: Monitor
    at: Served
    browser: Browser


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def site() -> AsyncIterator[Site]:
    network = FakeNetwork()
    async with AsyncExitStack() as stack:
        central, fleet = [await stack.enter_async_context(network.open_bus()) for _ in range(2)]
        folder = Path(stack.enter_context(TemporaryDirectory()))
        write_floor_plan(folder / "map.yaml", 1)
        monitor = monitor_on(central, plan=load_floor_plan(folder / "map.yaml"))
        work = (watch_fleet(central, monitor.fleet), monitor.health.run())
        running = [asyncio.create_task(each) for each in work]
        robot = await stack.enter_async_context(robot_on(fleet, "r1"))
        at = await stack.enter_async_context(served(monitor))
        yield Site(robot, fleet, monitor, at, await stack.enter_async_context(open_browser(*SOFTWARE_GL)))
        for task in running:
            task.cancel()
        await asyncio.wait(running)


async def test_an_overlay_is_drawn_while_somebody_looks_at_its_camera(site: Site, tmp_path: Path) -> None:
    assert BOXES not in site.robot.wanted
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/cameras/r1/front")
        await expect(page.locator(".fs-picture:not(.fs-old)")).to_be_visible()
        await page.wait_for_function("document.querySelector('.fs-picture').naturalWidth === 320")
        assert site.robot.wanted >= {BOXES}
        await expect(page.locator(".fs-row", has_text="box")).to_contain_text("2.62 m")
        await expect(page.get_by_text("Found by d-r1")).to_be_visible()
        await looker.picture("camera-desk-light")
        await page.get_by_text("Masks").click()
        await until(lambda: MASKS in site.robot.wanted and BOXES not in site.robot.wanted)
        await expect(page.locator(".fs-view a", has_text="In 3D")).to_have_attribute("href", "/objects/r1/front")
    await until(lambda: MASKS not in site.robot.wanted)


async def test_what_is_in_the_picture_and_what_is_settled_are_told_apart(site: Site, tmp_path: Path) -> None:
    site.robot.flickers = "ghost"
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/cameras/r1/front")
        await expect(page.get_by_role("heading", name="In this picture")).to_be_visible()
        await expect(page.get_by_role("heading", name="In view, settled")).to_be_visible()
        in_picture = page.locator(".fs-frame .fs-chip")
        await expect(in_picture.filter(has_text="box")).to_have_text("2box")
        await expect(in_picture.filter(has_text="ghost")).to_have_text("1ghost")
        await looker.picture("camera-frame-desk-light")
        await expect(in_picture.filter(has_text="ghost")).to_have_count(0)
        await expect(page.locator(".fs-row", has_text="box").locator(".fs-many")).to_have_text("2")
        await expect(page.locator(".fs-row", has_text="ghost")).to_have_count(0)
    site.robot.flickers = ""


async def test_what_another_model_counts_differently_is_told_while_it_does(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/cameras/r1/front")
        told = page.get_by_text("Another model counts 3 box")
        await expect(page.locator(".fs-row", has_text="box")).to_be_visible()
        await expect(told).to_be_hidden()
        opinions = CameraKey("r1", "front").stream(Stream.OPINION)
        async with site.bus.publisher(opinions, QoS.RESULT, encoding=codec.encoding(ClassList)) as publisher:
            for _ in range(30):
                boxes = [ClassCount("box", 3, 0.9)]
                header = site.robot.header()
                publisher.put(codec.encode(ClassList(header=header, classes=boxes, model="new.pt", worker="w9")))
                await asyncio.sleep(0.1)
            await expect(told).to_be_visible()
        await expect(page.locator(".fs-row", has_text="box").locator(".fs-many")).to_have_text("2")
        await expect(told).to_be_hidden()


async def test_a_picture_is_saved_for_training_when_an_operator_asks_for_it(site: Site, tmp_path: Path) -> None:
    asked: list[PictureRequest] = []

    async def save(request: Request) -> Reply:
        asked.append(codec.decode(PictureRequest, request.payload, request.encoding))
        saved = SavedPicture(file="train/images/r1-front_1.jpg", folder="/data/site", objects=2)
        return Reply(codec.encode(saved), codec.encoding(SavedPicture))

    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/cameras/r1/front")
        button = page.get_by_role("button", name="Save for training")
        await button.click()
        await expect(page.get_by_text("Not saved: nobody collects pictures: run fleetsight collect")).to_be_visible()
        async with site.bus.serve(keys.COLLECT, save):
            await expect(button).to_be_enabled()
            await button.click()
            told = "Saved: train/images/r1-front_1.jpg in /data/site, with drafts of 2 labels"
            await expect(page.get_by_text(told)).to_be_visible()
    (only,) = asked
    assert (only.robot, only.camera, bool(only.by)) == ("r1", "front", True)


async def test_an_object_is_cut_out_and_shown_in_3d_while_somebody_looks_at_it(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/objects/r1/front")
        await expect(page.locator("button.fs-row")).to_have_count(4)
        assert OBJECTS in site.robot.wanted
        await expect(page.get_by_text("3,200 points")).to_be_visible()
        await page.locator("button.fs-row", has_text="forklift").click()
        await expect(page.get_by_text("in base_link, 800 points")).to_be_visible()
        await expect(page.locator(".fs-scene canvas")).to_have_count(1)
        await looker.picture("objects-desk-light")
    await until(lambda: OBJECTS not in site.robot.wanted)


async def test_how_to_turn_a_scene_is_said_for_the_hand_that_does_it(site: Site, tmp_path: Path) -> None:
    mouse, fingers = "scroll to come nearer", "pinch to come nearer"
    for touch, said, unsaid in ((False, mouse, fingers), (True, fingers, mouse)):
        async with looking(site.browser, site.at, tmp_path, size="tablet", touch=touch) as looker:
            page = await looker.go("/objects/r1/front")
            await expect(page.get_by_text(said)).to_be_visible()
            await expect(page.get_by_text(unsaid)).to_be_hidden()


async def test_the_map_shows_where_robots_are_and_what_was_seen_where(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path, size="phone", scheme="dark") as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .robot.live text")).to_have_text("r1")
        await expect(page.locator(".fs-map .seen.fresh")).to_have_count(4)
        await expect(page.get_by_text("2 box")).to_be_visible()
        assert "tf" in site.robot.wanted
        assert await page.evaluate("document.documentElement.scrollWidth") == 375
        await looker.picture("map-phone-dark")
    await until(lambda: "tf" not in site.robot.wanted)


async def test_the_map_is_drawn_on_the_floor_plan(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        plan = page.locator(".fs-map image.plan")
        await expect(plan).to_be_visible()
        assert await page.evaluate(SIZE_OF_IMAGE, await plan.get_attribute("href")) == [333, 313]
        await looker.picture("map-desk-light")


async def test_zones_are_on_the_map_with_what_is_in_them(site: Site, tmp_path: Path) -> None:
    fleet = site.monitor.fleet
    fleet.world = World([DOCK, RACK])
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .zone polygon")).to_have_count(2)
        await expect(page.get_by_text("Zone dock: not known, as no world model tells of site hall")).to_be_visible()
        fleet.world.sites["hall"].replace("e", 0, [thing("a", 1), thing("p", 7, name="pallet")])
        fleet.sites.take(site_status("hall"), time_ns() + 60 * 10**9)
        await expect(page.get_by_text("Zone dock: 1 box; Zone rack: 1 pallet")).to_be_visible()
        await expect(page.locator(".fs-map .zone title").first).to_have_text("dock: 1 box")
        await looker.picture("zones-desk-light")
    fleet.world = World()


async def test_thin_walls_of_a_large_floor_plan_are_seen(site: Site) -> None:
    shades = np.full((200, 4 * MOST_CELLS), 254, np.uint16)
    shades[:, 150::300] = 0
    said = MapDescription(image="map.pgm", resolution=0.05, origin=(0, 0, 0), occupied_thresh=0.65, free_thresh=0.196)
    plan = FloorPlan.of(shades, 255, said)
    bounds = Bounds.around(plan.corners)
    assert bounds is not None
    picture = ground_of(bounds, (plan, f"data:image/png;base64,{b64encode(plan.png).decode()}"))
    page = await site.browser.new_page(viewport={"width": 1440, "height": 900})
    await page.set_content(
        f'<style>{VIEW_STYLE} .grid, .metres {{ display: none }}</style><div class="fs-map">{picture}</div>'
    )
    shown = np.asarray(Image.open(io.BytesIO(await page.locator("svg").screenshot())).convert("L"))
    dark = shown[len(shown) // 2] < 250
    await page.close()
    assert np.count_nonzero(dark[1:] & ~dark[:-1]) == np.count_nonzero(shades[0] == 0)


async def test_a_robot_that_is_lost_stays_on_the_map(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        async with robot_on(site.bus, "r3"):
            await expect(page.locator(".fs-map .robot.live", has_text="r3")).to_be_visible()
        await expect(page.locator(".fs-map .robot.lost text")).to_have_text(re.compile(r"r3, last seen \d+ s ago"))


async def test_robots_are_on_the_map_at_once_where_what_they_saw_says_they_are(site: Site, tmp_path: Path) -> None:
    async with robot_on(site.bus, "r7"):
        await until(lambda: "r7" in site.monitor.fleet.places.poses)
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/map")
        await expect(page.locator(".fs-map .robot.lost", has_text="r7")).to_be_visible()


async def test_what_is_not_there_says_what_to_do(site: Site, tmp_path: Path) -> None:
    async with looking(site.browser, site.at, tmp_path) as looker:
        page = await looker.go("/cameras/r9/front")
        await expect(page.get_by_text("No camera r9/front is known")).to_be_visible()
        await looker.go("/objects/r9/ros")
        await expect(page.get_by_text("camera name 'ros' is reserved")).to_be_visible()
        async with robot_on(site.bus, "r2"):
            await looker.go("/cameras/r2/front")
            await expect(page.locator(".fs-picture:not(.fs-old)")).to_be_visible()
        await expect(page.get_by_text("r2 is offline")).to_be_visible()
        await expect(page.locator(".fs-picture.fs-old")).to_be_visible()
        await looker.picture("camera-offline-desk-light")


async def test_a_monitor_without_a_link_says_so_and_not_that_the_robot_is_off(site: Site, tmp_path: Path) -> None:
    async with FakeNetwork().open_bus() as bus:
        deaf = monitor_on(bus)
    async with served(deaf) as at, looking(site.browser, at, tmp_path, size="phone") as looker:
        page = await looker.go("/cameras/r1/front")
        await expect(page.get_by_text("This monitor has no link to the fleet")).to_be_visible()
        await expect(page.get_by_text("switched on")).to_be_hidden()
        await looker.picture("camera-deaf-phone-light")
