"""A stream's last step, with a publisher on the fake bus."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import msgspec
import pytest

from bus import SMALL_BYTES, SMALL_WAITING
from bus.fake import FakeNetwork
from gateway.to_bus.shaping import stream_output as output_module
from schemas import codec
from schemas.camera_info import CameraInfo
from schemas.image import ImageFrame
from schemas.keys import sensor_key
from schemas.points import PointCloud
from schemas.ros import RawMessage
from schemas.status import ENDED, OVER_BUDGET, REPLACED_BEFORE_SHAPING, TOO_LARGE, UNSHAPED
from schemas.transforms import Transforms
from services.toolbox.logs import RateLimit, RateLimitFilter
from tests.gateway.to_bus.shaping.frames import cloud, frame, picture
from tests.gateway.to_bus.shaping.rig import Rig, numbered
from tests.gateway.to_bus.shaping.test_scaling import info
from tests.schemas.frames import header
from tests.schemas.pictures import compressed, file_of
from tests.waiting import receive, until

COLOR, DEPTH, INFO, POINTS, BATTERY, TF = (
    sensor_key("r1", name) for name in ("front/color", "front/depth", "front/info", "front/points", "ros/battery", "tf")
)


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    async with AsyncExitStack() as stack:
        yield Rig(FakeNetwork(), stack)


async def test_without_shaping_everything_goes_as_it_is(rig: Rig) -> None:
    output, arrived = await rig.output(COLOR)
    output.put(numbered(0))
    assert await receive(arrived, ImageFrame) == numbered(0)
    assert (output.counts.bytes, output.counts.compression) == (len(codec.encode(numbered(0))), "raw")


async def test_auto_is_raw_at_once_while_all_are_here_and_compressed_for_anybody_else(rig: Rig) -> None:
    output, arrived = await rig.output(COLOR, await rig.shaping())
    rig.listens(COLOR, "here")
    output.put(numbered(0))
    assert output.counts.bytes  # sent already: it waits for no thread
    assert (await receive(arrived, ImageFrame)).format == "raw"
    rig.listens(COLOR, "there")
    output.put(numbered(1))
    assert (await receive(arrived, ImageFrame)).format == "jpeg"
    assert output.counts.compression == "jpeg:80"
    rig.listens(COLOR, "here", alive=False)
    rig.listens(COLOR, "there", alive=False)
    output.put(numbered(2))
    assert (await receive(arrived, ImageFrame)).format == "jpeg"


async def test_a_raw_frame_does_not_overtake_one_that_is_being_compressed(rig: Rig) -> None:
    output, arrived = await rig.output(COLOR, await rig.shaping())
    output.put(numbered(0, size=500))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    rig.listens(COLOR, "here")
    output.put(numbered(1))
    assert [(await receive(arrived, ImageFrame)).header.seq for _ in range(2)] == [0, 1]


async def test_newest_wins_while_the_encoder_pool_is_busy(rig: Rig) -> None:
    output, arrived = await rig.output(COLOR, await rig.shaping(compression="png"))
    for seq in range(4):
        output.put(numbered(seq))
    assert (await receive(arrived, ImageFrame)).header.seq == 3
    assert output.counts.dropped == {REPLACED_BEFORE_SHAPING: 3}


async def test_depth_and_points_are_compressed_without_loss(rig: Rig) -> None:
    shaping = await rig.shaping()
    depth, depth_arrived = await rig.output(DEPTH, shaping)
    points, points_arrived = await rig.output(POINTS, shaping)
    depth.put(msgspec.structs.replace(frame("32FC1", picture()[..., 0].astype("f4"))))
    points.put(cloud())
    assert (await receive(depth_arrived, ImageFrame)).format == "zstd"
    assert (await receive(points_arrived, PointCloud)).format == "zstd"


async def test_a_frame_that_cannot_be_scaled_is_counted_and_said_once_in_a_while(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    output, arrived = await rig.output(COLOR, await rig.shaping(scale="1/2"))
    with caplog.filtering(RateLimitFilter(RateLimit())):
        output.put(compressed(file_of(picture(4, 6), ".png"), "rgb8", 18))
        await until(lambda: UNSHAPED in output.counts.dropped, "it is counted")
        output.put(compressed(file_of(picture(4, 6), ".png"), "rgb8", 18))
        await until(lambda: output.counts.dropped == {UNSHAPED: 2}, "it is counted again")
    (line,) = [record.getMessage() for record in caplog.records if record.name == output_module.__name__]
    assert line.startswith("fleet/r1/front/color: frame left out: a png that arrived as one cannot be scaled")
    output.put(numbered(1))
    assert (await receive(arrived, ImageFrame)).header.seq == 1


def raw_message(size: int) -> RawMessage:
    return RawMessage(
        header=header(camera=""), type="a/B", md5="", definition="", latched=False, data=memoryview(bytes(size))
    )


async def test_frames_wait_for_the_uplink_and_the_newest_wins_but_calibrations_go_at_once(rig: Rig) -> None:
    shaping = await rig.shaping(uplink_mbit=0.08, compression="raw")  # 10,000 bytes a second, 1,000 of them ahead
    color, frames = await rig.output(COLOR, shaping)
    battery, batteries = await rig.output(BATTERY, shaping)
    calibration, infos = await rig.output(INFO, shaping)
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


async def test_small_messages_wait_for_the_uplink_in_order_and_a_large_one_for_none(rig: Rig) -> None:
    shaping = await rig.shaping(uplink_mbit=0.08)  # 10,000 bytes a second, 1,000 of them ahead
    battery, arrived = await rig.output(BATTERY, shaping)
    sizes = range(400, 410)
    for size in sizes:
        battery.put(raw_message(size))
    assert 0 < battery.counts.bytes < 2_000
    assert [(await receive(arrived, RawMessage)).data.nbytes for _ in sizes] == list(sizes)
    assert battery.counts.dropped == {}
    for size in range(400, 400 + SMALL_WAITING + 10):
        battery.put(raw_message(size))
    assert battery.counts.dropped[OVER_BUDGET] in range(1, 11)
    waited = SMALL_WAITING + battery.counts.dropped[OVER_BUDGET]
    battery.put(raw_message(SMALL_BYTES + 1))
    assert battery.counts.dropped == {OVER_BUDGET: waited}


async def test_small_messages_that_wait_have_so_many_bytes_together(rig: Rig) -> None:
    battery, _ = await rig.output(BATTERY, await rig.shaping(uplink_mbit=0.01))
    for _ in range(5):
        battery.put(raw_message(30_000))
    assert battery.counts.dropped == {}
    battery.put(raw_message(SMALL_BYTES - 1_000))
    assert battery.counts.dropped == {OVER_BUDGET: 2}


async def test_small_messages_that_wait_go_at_once_when_all_who_listen_are_here(rig: Rig) -> None:
    battery, arrived = await rig.output(BATTERY, await rig.shaping(uplink_mbit=0.01))
    for size in range(400, 410):
        battery.put(raw_message(size))
    rig.listens(BATTERY, "here")
    battery.put(raw_message(410))
    assert [(await receive(arrived, RawMessage)).data.nbytes for _ in range(11)] == list(range(400, 411))


@pytest.mark.parametrize("uplink_mbit", [None, 8])
async def test_what_is_larger_than_receivers_read_is_left_out_and_counted(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, uplink_mbit: float | None
) -> None:
    monkeypatch.setattr(output_module, "MAX_PAYLOAD_BYTES", 2_000)
    shaping = await rig.shaping(compression="raw", uplink_mbit=uplink_mbit)
    for key, large, small in (
        (COLOR, numbered(0, size=30), numbered(1, size=10)),
        (BATTERY, raw_message(2_000), raw_message(1_000)),
    ):
        output, arrived = await rig.output(key, shaping)
        output.put(large)
        output.put(small)
        assert await receive(arrived, type(small)) == small
        assert output.counts.dropped == {TOO_LARGE: 1}


async def test_on_a_thin_uplink_a_cameras_streams_send_the_same_instants(rig: Rig) -> None:
    shaping = await rig.shaping(uplink_mbit=0.08, compression="raw")
    color, frames = await rig.output(COLOR, shaping)
    depth, depths = await rig.output(DEPTH, shaping)
    for seq in range(4):
        for output in (color, depth) if seq % 2 else (depth, color):
            output.put(stamped(seq))
    color.put(stamped(4))
    assert [(await receive(frames, ImageFrame)).header.seq for _ in range(3)] == [0, 3, 4]
    depth.put(stamped(4))
    assert [(await receive(depths, ImageFrame)).header.seq for _ in range(3)] == [0, 3, 4]
    assert color.counts.dropped == depth.counts.dropped == {OVER_BUDGET: 2}


async def test_on_a_thin_uplink_depth_of_the_few_frames_that_a_worker_can_use_goes_with_them(rig: Rig) -> None:
    shaping = await rig.shaping(uplink_mbit=0.08, compression="raw")
    color, frames = await rig.output(COLOR, shaping)
    depth, depths = await rig.output(DEPTH, shaping)
    for seq in range(0, 40, 2):
        if seq % 20 == 10:
            color.put(stamped(seq))
        depth.put(stamped(seq))
    assert [(await receive(frames, ImageFrame)).header.seq] == [30]
    assert 30 in [(await receive(depths, ImageFrame)).header.seq for _ in range(3)]
    assert color.counts.dropped == {OVER_BUDGET: 1}


async def test_on_a_thin_uplink_what_may_be_a_publishers_last_is_not_left_out_for_later_instants(rig: Rig) -> None:
    shaping = await rig.shaping(uplink_mbit=0.08, compression="raw")
    color, frames = await rig.output(COLOR, shaping)
    latched, depths = await rig.output(DEPTH, shaping)
    color.put(numbered(0, size=20))
    latched.put(stamped(1), may_be_last=True)
    for seq in (2, 3, 4):
        color.put(stamped(seq))
    assert [(await receive(frames, ImageFrame)).header.seq for _ in range(2)] == [0, 4]
    assert latched.counts.dropped == {}
    assert (await receive(depths, ImageFrame)).header.seq == 1


def stamped(seq: int) -> ImageFrame:
    """Return a frame of the seq-th instant, a fifth of what may be ahead of the link of a test."""
    frame = numbered(0, size=8)
    return msgspec.structs.replace(
        frame, header=msgspec.structs.replace(frame.header, seq=seq, stamp_ns=(seq + 1) * 100_000_000)
    )


async def test_what_stays_on_this_machine_needs_no_uplink(rig: Rig) -> None:
    color, frames = await rig.output(COLOR, await rig.shaping(uplink_mbit=0.08, compression="raw"))
    for seq in range(3):
        color.put(numbered(seq, size=30))
    rig.listens(COLOR, "here")
    color.put(numbered(3, size=30))
    assert [(await receive(frames, ImageFrame)).header.seq for _ in range(2)] == [0, 3]
    assert color.counts.dropped == {OVER_BUDGET: 2}


@pytest.mark.parametrize(("clock", "sent"), [("here", [0]), ("there", [])])
async def test_transforms_take_of_the_uplink_what_leaves_this_machine_and_go_at_once(
    rig: Rig, clock: str, sent: list[int]
) -> None:
    shaping = await rig.shaping(uplink_mbit=0.08, compression="raw")  # 10,000 bytes a second, 1,000 of them ahead
    moving, arrived = await rig.output(TF, shaping)
    color, frames = await rig.output(COLOR, shaping)
    rig.listens(TF, clock)
    rig.listens(COLOR, "there")
    for _ in range(100):
        moving.put(Transforms(header=header(camera=""), transforms=[]))
    assert moving.counts.bytes > 10_000
    color.put(numbered(0))
    await until(lambda: arrived.counts.received == 100, "no transforms are left out")
    assert frames.counts.received == len(sent)
    assert color.counts.bytes == sum(len(codec.encode(numbered(seq))) for seq in sent)


async def test_an_output_that_is_closed_sends_nothing_more(rig: Rig) -> None:
    for settings in ({"uplink_mbit": 0.08, "compression": "raw"}, {"compression": "png"}):
        output, _ = await rig.output(COLOR, await rig.shaping(**settings))
        for seq in range(3):
            output.put(numbered(seq, size=30))
        sent = output.counts.bytes
        output.close()
        await asyncio.sleep(0.3)
        assert output.counts.bytes == sent
        assert output.counts.dropped[ENDED] == 1
