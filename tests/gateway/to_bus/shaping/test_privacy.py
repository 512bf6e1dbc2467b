"""Areas of images that nobody is to see: whatever becomes of a frame, nothing of them leaves the gateway."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import numpy as np
import pytest

from bus import QoS
from bus.fake import FakeNetwork
from gateway.to_bus.shaping.compression import LOSSY, NONE
from gateway.to_bus.shaping.encoder_pool import EncodeJob
from gateway.to_bus.shaping.privacy import blackened
from gateway.to_bus.shaping.scaling import ShapingError, pixels_of
from gateway.to_bus.shaping.settings import ShapingSettings
from gateway.to_bus.shaping.stream_output import OutputPlan, StreamOutput
from schemas import codec
from schemas.image import ImageFrame, parse_area
from schemas.keys import sensor_key
from schemas.status import UNSHAPED
from tests.gateway.to_bus.shaping.frames import decoded, frame, picture
from tests.gateway.to_bus.shaping.rig import Rig, numbered
from tests.schemas.pictures import compressed, file_of
from tests.waiting import receive, until

COLOR, DEPTH = sensor_key("r1", "front/color"), sensor_key("r1", "front/depth")
LEFT_HALF = parse_area("0:0 0.5:0 0.5:1 0:1")
WHITE = np.full((48, 64, 3), 255, np.uint8)


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    async with AsyncExitStack() as stack:
        yield Rig(FakeNetwork(), stack)


@pytest.mark.parametrize(
    ("encoding", "channels", "black"),
    [
        ("rgb8", 3, [0, 0, 0]),
        ("bgr8", 3, [0, 0, 0]),
        ("rgba8", 4, [0, 0, 0, 255]),
        ("bgra8", 4, [0, 0, 0, 255]),
        ("mono8", 1, [0]),
        ("yuv422", 2, [128, 16]),
        ("bayer_rggb8", 1, [0]),
    ],
)
@pytest.mark.parametrize("padding", [0, 5])
def test_the_area_and_no_more_than_a_pixel_beside_it_is_black(
    encoding: str, channels: int, black: list[int], padding: int
) -> None:
    before = np.full((48, 64, channels), 200, np.uint8)
    after = pixels_of(blackened(frame(encoding, before, padding=padding), (LEFT_HALF,)))
    assert (after[:, :33] == black).all()
    assert (after[:, 34:] == 200).all()


@pytest.mark.parametrize(("encoding", "kind"), [("16UC1", np.uint16), ("32FC1", np.float32)])
@pytest.mark.parametrize("is_bigendian", [False, True])
def test_depth_has_no_reading_there(encoding: str, kind: type, *, is_bigendian: bool) -> None:
    before = frame(encoding, np.full((48, 64), 3, kind), is_bigendian=is_bigendian)
    after = pixels_of(blackened(before, (LEFT_HALF,)))[..., 0]
    assert not (after[:, :33] > 0).any()
    assert (after[:, 34:] == 3).all()


def test_an_area_may_have_any_shape_and_several_add_up() -> None:
    triangle, spot = parse_area("0:0 1:0 0:1"), parse_area("0.9:0.9 0.9:0.9 0.9:0.9")
    after = pixels_of(blackened(frame("rgb8", WHITE), (triangle, spot)))[..., 0]
    assert after[0, 60] == after[45, 0] == after[20, 30] == after[43, 57] == 0
    assert after[47, 63] == after[30, 40] == after[40, 50] == 255
    hollow = parse_area("0:0 1:0 1:1 0:1 0:0.1 0.9:0.9 0.9:0.1 0:0.1")
    assert pixels_of(blackened(frame("rgb8", WHITE), (hollow,)))[4:8, 62:].max() == 0


def test_where_an_areas_sides_cross_all_that_they_surround_is_black() -> None:
    star = parse_area("0.5:0 0.8:1 0:0.4 1:0.4 0.2:1")
    after = pixels_of(blackened(frame("rgb8", WHITE), (star,)))[..., 0]
    assert after[24, 32] == after[20, 20] == 0
    assert after[2, 2] == 255


def test_an_area_narrower_than_a_pixel_is_black_too() -> None:
    line = parse_area("0.501:0 0.502:0 0.502:1 0.501:1")
    assert pixels_of(blackened(frame("rgb8", WHITE), (line,)))[:, 32].max() == 0


def test_it_is_black_before_it_is_scaled_so_that_nothing_is_mixed_into_its_neighbours() -> None:
    seen = np.zeros((48, 64, 3), np.uint8)
    seen[:, :32] = 255  # all that there is to hide
    made = EncodeJob(frame("rgb8", seen), 3, NONE, private=(LEFT_HALF,)).do()
    assert pixels_of(codec.decode(ImageFrame, made.payload, codec.encoding(ImageFrame))).max() == 0


def test_what_arrived_as_a_jpeg_is_decoded_for_it() -> None:
    file = compressed(file_of(WHITE, ".jpg"), "rgb8", 192, kind="jpeg", height=48, width=64)
    made = EncodeJob(file, 1, LOSSY, private=(LEFT_HALF,)).do()
    arrived = codec.decode(ImageFrame, made.payload, codec.encoding(ImageFrame))
    assert (arrived.format, str(made.method)) == ("jpeg", "jpeg:80")
    assert str(EncodeJob(file, 1, NONE, private=(LEFT_HALF,)).do().method) == "jpeg:80"
    assert str(EncodeJob(frame("rgb8", WHITE), 1, NONE, private=(LEFT_HALF,)).do().method) == "raw"
    assert decoded(arrived)[:, :24].max() <= 2
    assert decoded(arrived)[:, 40:].min() >= 250


def test_what_cannot_be_blackened_is_refused() -> None:
    png = compressed(file_of(WHITE, ".png"), "rgb8", 192, height=48, width=64)
    with pytest.raises(
        ShapingError, match=r"^a png that arrived as one cannot be blackened in part: use the raw topic"
    ):
        blackened(png, (LEFT_HALF,))
    torn = compressed(file_of(WHITE, ".jpg")[:200], "rgb8", 192, kind="jpeg", height=48, width=64)
    with pytest.raises(ShapingError, match=r"^a jpeg that cannot be decoded: "):
        blackened(torn, (LEFT_HALF,))


async def test_a_raw_frame_for_neighbours_is_blackened_too_and_one_that_cannot_be_is_not_sent(rig: Rig) -> None:
    shaping = await rig.shaping(privacy_mask=["front/*=0:0 1:0 1:1 0:1"])
    output, arrived = await rig.output(COLOR, shaping)
    rig.listens(COLOR, "here")
    output.put(numbered(0))
    made = await receive(arrived, ImageFrame)
    assert (made.format, pixels_of(made).max()) == ("raw", 0)
    output.put(compressed(file_of(picture(4, 6), ".png"), "rgb8", 18))
    await until(lambda: output.counts.dropped == {UNSHAPED: 1})
    assert output.counts.bytes == len(codec.encode(made))
    depths, readings = await rig.output(DEPTH, shaping)
    depths.put(frame("16UC1", np.full((4, 4), 7, np.uint16)))
    assert decoded(await receive(readings, ImageFrame)).max() == 0


async def test_points_of_such_a_camera_are_said_to_be_sent_as_they_are(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    shaping = await rig.shaping(privacy_mask=["front/depth=0:0 1:0 1:1 0:1"])
    await rig.output(sensor_key("r1", "rear/points"), shaping)
    assert not caplog.messages
    await rig.output(sensor_key("r1", "front/points"), shaping)
    await rig.output(sensor_key("r1", "ros/front/image"), shaping)
    assert [each.partition(": ")[::2] for each in caplog.messages] == [
        ("fleet/r1/front/points", "points are sent as they are: --privacy-mask is for images; --deny keeps them here"),
        ("fleet/r1/ros/front/image", "sent as it is: --privacy-mask is for cameras' images"),
    ]


async def test_what_nobody_can_blacken_is_not_sent(rig: Rig) -> None:
    bus = await rig._stack.enter_async_context(rig.network.open_bus())
    publisher = await rig._stack.enter_async_context(bus.publisher(str(COLOR), QoS.IMAGE))
    output = StreamOutput(COLOR, publisher, OutputPlan(private=(LEFT_HALF,)))
    output.put(numbered(0))
    assert (output.counts.dropped, output.counts.bytes) == ({UNSHAPED: 1}, 0)


def test_rules_add_up_for_the_streams_that_they_fit() -> None:
    settings = ShapingSettings(privacy_mask=["0:0 1:0 1:1", "front/color=0:0 0:1 1:1", "rear/*=0:0 1:1 1:0"])
    assert [len(settings.private_areas_of(name)) for name in ("front/color", "front/depth", "rear/color")] == [2, 1, 2]
    from_file = ShapingSettings.model_validate({"privacy_mask": {"front/color": "0:0 1:0 1:1"}})
    assert from_file.private_areas_of("front/color") == (((0, 0), (1, 0), (1, 1)),)
    assert list(settings.unused_shaping(["front/color"])) == ["--privacy-mask rear/*"]


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("0:0 1:0", "'0:0 1:0' is not an area; use 3 to 64 corners like 0:0 1:0 1:0.2"),
        ("front/color=", "'' is not an area"),
        ("front/color=0:0 1:0 640:480", "'640:480' is not a corner; use ACROSS:DOWN, each from 0 to 1, like 0.5:0.2"),
        ("0:0 1:0 nan:1", "'nan:1' is not a corner"),
        ("0:0 1:0 1", "'1' is not a corner"),
        ("front/points=0:0 1:0 1:1", "'front/points' matches no stream this applies to, like front/color, depth"),
        (" ".join(["0:0"] * 65), "is not an area"),
    ],
)
def test_areas_that_are_none_are_named(value: str, reason: str) -> None:
    with pytest.raises(ValueError, match="privacy_mask") as caught:
        ShapingSettings(privacy_mask=[value])
    assert reason in str(caught.value)
