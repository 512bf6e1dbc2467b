"""A person's view at the robot: rviz with overlay and points, or with the objects around, on a screen in memory."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from bus import QoS
from gateway.to_ros.stream import MALFORMED
from schemas import codec
from schemas.keys import NEARBY, CameraKey, RobotStreamKey, Stream
from schemas.objects import ObjectCloud, ObjectClouds
from schemas.world import NearbyObjects
from tests.gateway.to_ros.overlays import BLUE, RED, overlay
from tests.gateway.to_ros.test_world import known as known_object
from tests.integration.detecting import results
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.peers.ros import PEERS, RosEnvironment, require_ros
from tests.integration.to_ros.screen import XVFB, Screen, screen_in
from tests.integration.to_ros.test_returned_streams import tell
from tests.schemas.results import cloud, clouds
from tests.waiting import until

RVIZ = "/usr/lib/rviz/rviz"
CONFIG, WORLD_CONFIG = PEERS / "returns.rviz", PEERS / "world.rviz"
FRONT = CameraKey("r1", "front")
GREEN, VIOLET, ORANGE = (20, 200, 40), (160, 30, 200), (250, 120, 10)


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


def greenish(screen: Screen) -> int:
    """Count the pixels that are of a pallet's marker, which is lit and half transparent."""
    red, green, blue = np.moveaxis(screen.pixels().astype(int), -1, 0)
    return int(((green > red + 40) & (green > blue + 40)).sum())


@pytest.mark.timeout(120)
async def test_rviz_shows_the_objects_around_and_obstacles(ros: RosEnvironment, rig: FleetRig, tmp_path: Path) -> None:
    require_ros(RVIZ, XVFB)
    await rig.gateway("r1", ros.master_uri, {"front": "/front/color/image_raw"})
    key, encoding = RobotStreamKey("r1", NEARBY), codec.encoding(NearbyObjects)
    async with screen_in(ros, tmp_path) as screen, rig.bus.publisher(str(key), QoS.RESULT, encoding=encoding) as world:
        options = (RVIZ, "--display-config", str(WORLD_CONFIG))
        rviz = await ros.run("/usr/bin/env", f"DISPLAY={screen.display}", "LIBGL_ALWAYS_SOFTWARE=1", *options)
        telling = asyncio.create_task(tell(world, known_object("a-1"), known_object("a-2", at=(3.0, 2.5, 0.5))))
        try:
            await screen.until_seen(ORANGE, pixels=500)
            await until(lambda: greenish(screen) > 2_000, "rviz shows both boxes")
        except TimeoutError:
            pytest.fail(f"rviz does not show them: {screen.count(ORANGE)}, {greenish(screen)}, {rviz.output}")
        telling.cancel()
        await rviz.end()
