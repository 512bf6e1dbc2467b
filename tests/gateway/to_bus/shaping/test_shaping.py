"""What the streams of one gateway share."""

import gc
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import pytest

from bus.fake import FakeNetwork
from gateway.to_bus.shaping.frame_rates import Instants
from schemas.camera_info import CameraInfo
from schemas.image import ImageFrame
from schemas.keys import sensor_key
from schemas.points import PointCloud
from tests.gateway.to_bus.shaping.frames import cloud, frame, picture
from tests.gateway.to_bus.shaping.rig import Rig, numbered
from tests.gateway.to_bus.shaping.test_scaling import info
from tests.waiting import receive

COLOR, DEPTH, INFO, DEPTH_INFO, POINTS, BATTERY = (
    sensor_key("r1", name)
    for name in ("front/color", "front/depth", "front/info", "front/depth_info", "front/points", "ros/battery")
)


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    async with AsyncExitStack() as stack:
        yield Rig(FakeNetwork(), stack)


async def test_what_is_scaled_has_a_scaled_calibration(rig: Rig) -> None:
    shaping = await rig.shaping(scale="*/color=1/2", compression="raw")
    color, frames = await rig.output(COLOR, shaping)
    depth, depths = await rig.output(DEPTH, shaping)
    calibration, infos = await rig.output(INFO, shaping)
    depth_calibration, depth_infos = await rig.output(DEPTH_INFO, shaping)
    color.put(numbered(0, size=480))
    depth.put(frame("16UC1", picture()[..., 0].astype("u2")))
    calibration.put(info())
    depth_calibration.put(info())
    assert (await receive(frames, ImageFrame)).width == 240
    assert (await receive(depths, ImageFrame)).width == 64
    assert (await receive(infos, CameraInfo)).width == 320
    assert await receive(depth_infos, CameraInfo) == info()


async def test_depth_is_scaled_with_its_own_calibration(rig: Rig) -> None:
    shaping = await rig.shaping(scale="1/2")
    calibration, infos = await rig.output(DEPTH_INFO, shaping)
    points, clouds = await rig.output(POINTS, shaping)
    calibration.put(info())
    points.put(cloud())
    assert (await receive(infos, CameraInfo)).k[2] == 160
    assert (await receive(clouds, PointCloud)).width == cloud().width


async def test_a_cameras_streams_share_their_instants_and_only_what_may_be_left_out_has_a_rate(rig: Rig) -> None:
    shaping = await rig.shaping(max_hz="10")
    assert shaping.rate_limiter(INFO) is None
    assert shaping.rate_limiter(sensor_key("r1", "tf")) is None
    color, depth, battery = (shaping.rate_limiter(key) for key in (COLOR, DEPTH, BATTERY))
    assert color is not None
    assert depth is not None
    assert battery is not None
    assert (color.max_hz, depth.max_hz, battery.max_hz) == (10, 10, None)
    second = 1_000_000_000
    assert [color.passes(n * second // 30, 0) for n in (1, 2, 4)] == [True, False, True]
    assert [depth.passes(n * second // 30, 0) for n in (2, 4)] == [False, True]


async def test_a_cameras_instants_begin_anew_only_when_all_of_its_streams_were_away(rig: Rig) -> None:
    shaping = await rig.shaping(max_hz="1")
    rate_limiter = shaping.rate_limiter(COLOR)
    assert rate_limiter is not None
    tenth = 100_000_000
    async with AsyncExitStack() as present:
        await Rig(rig.network, present).output(DEPTH, shaping)
        async with AsyncExitStack() as away:
            await Rig(rig.network, away).output(COLOR, shaping)
            assert rate_limiter.passes(1, 1)
        await Rig(rig.network, present).output(COLOR, shaping)
        assert not rate_limiter.passes(tenth, tenth)
    await rig.output(COLOR, shaping)
    assert rate_limiter.passes(2 * tenth, 2 * tenth)


async def test_cameras_that_come_and_go_leave_nothing_behind(rig: Rig) -> None:
    shaping = await rig.shaping(max_hz="10", uplink_mbit="8")
    before = instants_in_memory()
    for number in range(5):
        key = sensor_key("r1", f"camera_{number}/color")
        rate_limiter = shaping.rate_limiter(key)
        async with AsyncExitStack() as present:
            output, frames = await Rig(rig.network, present).output(key, shaping)
            assert rate_limiter is not None
            assert rate_limiter.passes(1, 1)
            output.put(numbered(0))
            await receive(frames, ImageFrame)
    assert instants_in_memory() == before


def instants_in_memory() -> int:
    gc.collect()
    return sum(isinstance(found, Instants) for found in gc.get_objects())
