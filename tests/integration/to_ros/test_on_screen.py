"""What a person at the robot sees: rviz with an overlay and the objects' points, on a screen in memory."""

from collections.abc import AsyncIterator, Sequence
from pathlib import Path

import pytest

from gateway.to_ros.stream import MALFORMED
from schemas.keys import CameraKey, Stream
from schemas.objects import ObjectCloud, ObjectClouds
from tests.gateway.to_ros.overlays import BLUE, RED, overlay
from tests.integration.detecting import results
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.peers.ros import PEERS, RosEnvironment, require_ros
from tests.integration.to_ros.screen import XVFB, screen_in
from tests.schemas.results import cloud, clouds

RVIZ = "/usr/lib/rviz/rviz"
CONFIG = PEERS / "returns.rviz"
FRONT = CameraKey("r1", "front")
GREEN, VIOLET = (20, 200, 40), (160, 30, 200)


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


def two_objects(seq: int) -> ObjectClouds:
    return clouds(row_of(GREEN, x=-1, index=0), row_of(VIOLET, x=1, index=1), seq=seq)


def row_of(color: Sequence[int], *, x: float, index: int) -> ObjectCloud:
    points = [(x, y / 4, 0.0) for y in range(-4, 5)]
    return cloud(*points, rgb=bytes(color) * len(points), index=index)


@pytest.mark.timeout(120)
async def test_rviz_shows_the_overlay_and_the_points(ros: RosEnvironment, rig: FleetRig, tmp_path: Path) -> None:
    require_ros(RVIZ, XVFB)
    await rig.gateway("r1", ros.master_uri, {"front": "/front/color/image_raw"})
    async with (
        screen_in(ros, tmp_path) as screen,
        results(rig.bus, FRONT, Stream.OVERLAY_SEGMENTATION, lambda seq: overlay(seq=seq, height=240, width=320)),
        results(rig.bus, FRONT, Stream.OBJECTS, two_objects),
    ):
        seen = (RED, BLUE, GREEN, VIOLET)
        assert [screen.count(color) for color in seen] == [0, 0, 0, 0]
        options = (RVIZ, "--display-config", str(CONFIG))
        rviz = await ros.run("/usr/bin/env", f"DISPLAY={screen.display}", "LIBGL_ALWAYS_SOFTWARE=1", *options)
        try:
            await screen.until_seen(*seen, pixels=500)
        except TimeoutError:
            pytest.fail(f"rviz does not show them: {[screen.count(color) for color in seen]}, {rviz.output}")
        for stream in (Stream.OVERLAY_SEGMENTATION, Stream.OBJECTS):
            status = await rig.return_status("r1", "front", lambda of: of.published > 0, stream=stream)
            assert MALFORMED not in status.dropped
        await rviz.end()
