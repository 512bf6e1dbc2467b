"""A stream's last step, with a publisher on the fake bus."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import msgspec
import pytest

from bus import QUEUE, Presence, Subscription
from bus.fake import FakeNetwork
from gateway.shaping.consumers import Consumers
from gateway.shaping.outlet import Outlet, unshaped
from gateway.shaping.settings import ShapingSettings
from gateway.shaping.shaping import Shaping
from gateway.translators import kind_of
from schemas import codec
from schemas.camera_info import CameraInfo
from schemas.codec import M
from schemas.image import ImageFrame
from schemas.keys import SensorKey, StreamKey, Wanted, sensor_key
from schemas.points import PointCloud
from schemas.raw import RawMessage
from schemas.status import OVER_BUDGET, REPLACED_BEFORE_SHAPING, UNSHAPED
from tests.gateway.ros1.waiting import until
from tests.gateway.shaping.frames import cloud, frame, picture
from tests.gateway.shaping.test_scaling import info
from tests.schemas.frames import header
from tests.schemas.pictures import compressed, file_of

COLOR, DEPTH, INFO, POINTS, BATTERY = (
    sensor_key("r1", name) for name in ("front/color", "front/depth", "front/info", "front/points", "ros/battery")
)


class Rig:
    """The streams of a robot on a fake bus."""

    def __init__(self, network: FakeNetwork, stack: AsyncExitStack) -> None:
        self._network = network
        self._stack = stack
        self.consumers = Consumers("r1", "here", near=True)

    async def shaping(self, **settings: object) -> Shaping:
        """Run the shaping of a gateway with such settings."""
        made = Shaping(ShapingSettings.model_validate(settings), self.consumers)
        bus = await self._stack.enter_async_context(self._network.open_bus())
        running = asyncio.create_task(made.run(bus))
        self._stack.push_async_callback(asyncio.wait, [running])
        self._stack.callback(running.cancel)
        return made

    async def outlet(self, key: SensorKey, shaping: Shaping | None = None) -> tuple[Outlet, Subscription]:
        """Open a stream's way, and see what arrives."""
        bus = await self._stack.enter_async_context(self._network.open_bus())
        kind = kind_of(key)
        publisher = await self._stack.enter_async_context(bus.publisher(str(key), kind.qos, encoding=kind.encoding))
        arrived = await self._stack.enter_async_context(bus.subscribe(str(key), QUEUE(999)))
        open_way = unshaped if shaping is None else shaping.outlet
        return self._stack.enter_context(open_way(key, publisher)), arrived

    def listens(self, key: SensorKey, clock: str, *, alive: bool = True) -> None:
        assert isinstance(key, StreamKey)
        self.consumers.note(Presence(str(Wanted(key, clock, "w1")), alive))


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    async with AsyncExitStack() as stack:
        yield Rig(FakeNetwork(), stack)


async def receive(arrived: Subscription, schema: type[M]) -> M:
    async with asyncio.timeout(10):
        sample = await anext(arrived)
    return codec.decode(schema, sample.payload, sample.encoding)


def numbered(seq: int, size: int = 4) -> ImageFrame:
    return msgspec.structs.replace(frame("rgb8", picture(size, size)), header=header(seq=seq))


async def test_without_shaping_everything_goes_as_it_is(rig: Rig) -> None:
    outlet, arrived = await rig.outlet(COLOR)
    outlet.put(numbered(0))
    assert await receive(arrived, ImageFrame) == numbered(0)
    assert (outlet.counts.bytes, outlet.counts.compression) == (len(codec.encode(numbered(0))), "raw")


async def test_auto_is_raw_at_once_while_all_are_here_and_compressed_for_anybody_else(rig: Rig) -> None:
    outlet, arrived = await rig.outlet(COLOR, await rig.shaping())
    rig.listens(COLOR, "here")
    outlet.put(numbered(0))
    assert outlet.counts.bytes  # sent already: it waits for no thread
    assert (await receive(arrived, ImageFrame)).format == "raw"
    rig.listens(COLOR, "there")
    outlet.put(numbered(1))
    assert (await receive(arrived, ImageFrame)).format == "jpeg"
    assert outlet.counts.compression == "jpeg:80"
    rig.listens(COLOR, "here", alive=False)
    rig.listens(COLOR, "there", alive=False)
    outlet.put(numbered(2))
    assert (await receive(arrived, ImageFrame)).format == "jpeg"


async def test_a_raw_frame_does_not_overtake_one_that_is_being_compressed(rig: Rig) -> None:
    outlet, arrived = await rig.outlet(COLOR, await rig.shaping())
    outlet.put(numbered(0, size=500))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    rig.listens(COLOR, "here")
    outlet.put(numbered(1))
    assert [(await receive(arrived, ImageFrame)).header.seq for _ in range(2)] == [0, 1]


async def test_newest_wins_while_the_workshop_is_busy(rig: Rig) -> None:
    outlet, arrived = await rig.outlet(COLOR, await rig.shaping(compression="png"))
    for seq in range(4):
        outlet.put(numbered(seq))
    assert (await receive(arrived, ImageFrame)).header.seq == 3
    assert outlet.counts.dropped == {REPLACED_BEFORE_SHAPING: 3}


async def test_depth_and_points_are_compressed_without_loss(rig: Rig) -> None:
    shaping = await rig.shaping()
    depth, depth_arrived = await rig.outlet(DEPTH, shaping)
    points, points_arrived = await rig.outlet(POINTS, shaping)
    depth.put(msgspec.structs.replace(frame("32FC1", picture()[..., 0].astype("f4"))))
    points.put(cloud())
    assert (await receive(depth_arrived, ImageFrame)).format == "zstd"
    assert (await receive(points_arrived, PointCloud)).format == "zstd"


async def test_what_is_scaled_has_a_scaled_calibration(rig: Rig) -> None:
    shaping = await rig.shaping(scale="*/color=1/2", compression="raw")
    color, frames = await rig.outlet(COLOR, shaping)
    depth, depths = await rig.outlet(DEPTH, shaping)
    calibration, infos = await rig.outlet(INFO, shaping)
    depth_calibration, depth_infos = await rig.outlet(sensor_key("r1", "front/depth_info"), shaping)
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
    calibration, infos = await rig.outlet(sensor_key("r1", "front/depth_info"), shaping)
    points, clouds = await rig.outlet(POINTS, shaping)
    calibration.put(info())
    points.put(cloud())
    assert (await receive(infos, CameraInfo)).k[2] == 160
    assert (await receive(clouds, PointCloud)).width == cloud().width


async def test_a_frame_that_cannot_be_scaled_is_counted(rig: Rig) -> None:
    outlet, arrived = await rig.outlet(COLOR, await rig.shaping(scale="1/2"))
    outlet.put(compressed(file_of(picture(4, 6), ".png"), "rgb8", 18))
    await until(lambda: outlet.counts.dropped == {UNSHAPED: 1, REPLACED_BEFORE_SHAPING: 0}, "it is counted")
    outlet.put(numbered(1))
    assert (await receive(arrived, ImageFrame)).header.seq == 1


def raw_message(size: int) -> RawMessage:
    return RawMessage(
        header=header(camera=""), type="a/B", md5="", definition="", latched=False, data=memoryview(bytes(size))
    )


async def test_frames_wait_for_the_uplink_and_the_newest_wins_but_calibrations_go_at_once(rig: Rig) -> None:
    shaping = await rig.shaping(uplink_mbit=0.08, compression="raw")  # 10,000 bytes a second, 1,000 of them ahead
    color, frames = await rig.outlet(COLOR, shaping)
    battery, batteries = await rig.outlet(BATTERY, shaping)
    calibration, infos = await rig.outlet(INFO, shaping)
    color.put(numbered(0, size=20))
    for seq in (1, 2, 3):
        color.put(numbered(seq))
    battery.put(raw_message(50))
    calibration.put(info())
    assert calibration.counts.bytes
    assert await receive(infos, CameraInfo) == info()
    assert [(await receive(frames, ImageFrame)).header.seq for _ in range(2)] == [0, 3]
    assert (await receive(batteries, RawMessage)).data.nbytes == 50
    assert color.counts.dropped == {OVER_BUDGET: 2}


async def test_what_stays_on_this_machine_needs_no_uplink(rig: Rig) -> None:
    color, frames = await rig.outlet(COLOR, await rig.shaping(uplink_mbit=0.08, compression="raw"))
    for seq in range(3):
        color.put(numbered(seq, size=30))
    rig.listens(COLOR, "here")
    color.put(numbered(3, size=30))
    assert [(await receive(frames, ImageFrame)).header.seq for _ in range(2)] == [0, 3]
    assert color.counts.dropped == {OVER_BUDGET: 2}


async def test_an_outlet_that_is_closed_sends_nothing_more(rig: Rig) -> None:
    for settings in ({"uplink_mbit": 0.08, "compression": "raw"}, {"compression": "png"}):
        outlet, _ = await rig.outlet(COLOR, await rig.shaping(**settings))
        for seq in range(3):
            outlet.put(numbered(seq, size=30))
        sent = outlet.counts.bytes
        outlet.close()
        await asyncio.sleep(0.3)
        assert outlet.counts.bytes == sent


async def test_a_cameras_streams_share_their_instants_and_only_what_may_be_left_out_has_a_rate(rig: Rig) -> None:
    shaping = await rig.shaping(max_hz="10")
    assert shaping.thinning(INFO) is None
    assert shaping.thinning(sensor_key("r1", "tf")) is None
    color, depth, battery = (shaping.thinning(key) for key in (COLOR, DEPTH, BATTERY))
    assert color is not None
    assert depth is not None
    assert battery is not None
    assert (color.max_hz, depth.max_hz, battery.max_hz) == (10, 10, None)
    second = 1_000_000_000
    assert [color.passes(n * second // 30, 0) for n in (1, 2, 4)] == [True, False, True]
    assert [depth.passes(n * second // 30, 0) for n in (2, 4)] == [False, True]
