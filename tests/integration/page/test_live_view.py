"""The guide's whole chain as it is run: rospy camera, gateway, detector, monitor, and somebody with a browser."""

from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from playwright.async_api import expect

from bus import QoS
from schemas.keys import Stream
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.monitor.test_web import PASSWORD, said
from tests.integration.page.browser import PATIENCE_MS, open_browser
from tests.integration.peers.ros import RosEnvironment
from tests.integration.to_bus.test_first_light import CAMERAS, FRONT, camera, raw
from tests.services.detector.support.views import NEAR_VIEWS, near_view
from tests.waiting import until

expect.set_options(timeout=PATIENCE_MS)


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


@pytest.mark.timeout(240)
async def test_a_real_detector_draws_while_somebody_looks_at_the_cameras_page(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    view = next(iter(NEAR_VIEWS))
    await camera(ros, CAMERAS["front"], [raw(tmp_path, "view.rgb", near_view(view))])
    await rig.gateway("r1", ros.master_uri, {"front": CAMERAS["front"]})
    await rig.start("detector")
    history = f"sqlite:///{tmp_path / 'history.db'}"
    monitor = await rig.start("monitor", "--mode", "client", "--web-port", "0", "--history", history)
    url, link = await said(monitor, r"page: (\S+)"), await said(monitor, r"first user: (\S+)")
    async with (
        rig.bus.publisher(FRONT.stream(Stream.OVERLAY_DETECTION), QoS.IMAGE) as boxes,
        rig.bus.publisher(FRONT.stream(Stream.OVERLAY_SEGMENTATION), QoS.IMAGE) as masks,
        open_browser() as browser,
    ):
        page = await browser.new_page(viewport={"width": 1440, "height": 900})
        page.set_default_timeout(PATIENCE_MS)
        await page.goto(link)
        await page.get_by_label("Name").fill("ann")
        await page.get_by_label("Password", exact=True).fill(PASSWORD)
        await page.get_by_label("Password again").fill(PASSWORD)
        await page.get_by_role("button").click()
        await page.goto(f"{url}/in-view")
        for name in view.classes:
            await expect(page.locator("td", has_text=name).first).to_be_visible()
        assert (boxes.wanted, masks.wanted) == (False, False)
        await page.goto(f"{url}/cameras/r1/front")
        await page.wait_for_function("document.querySelector('.fs-picture')?.naturalWidth === 640")
        assert (boxes.wanted, masks.wanted) == (True, False)
        shown = await page.locator(".fs-picture").get_attribute("src")
        await page.get_by_text("Masks").click()
        await until(lambda: masks.wanted and not boxes.wanted)
        await page.wait_for_function("before => document.querySelector('.fs-picture').src !== before", arg=shown)
        await page.goto(f"{url}/health")
        await until(lambda: not masks.wanted)
        assert not boxes.wanted
