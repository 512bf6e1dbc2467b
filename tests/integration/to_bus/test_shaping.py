"""Frames of Debian's real ROS 1, thinned and compressed by a real gateway on their way to Zenoh."""

import struct
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from backports import zstd

from bus import Subscription
from gateway.to_bus.shaping.frame_rates import BURST_S
from schemas.compression import picture_of
from schemas.consumer_keys import Wanted
from schemas.detections import ClassList
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey
from schemas.status import THINNED
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import PEERS, RosEnvironment
from tests.integration.peers.rospy_scripts import OFF_CAMERA
from tests.integration.to_bus.test_first_light import CAMERAS, FRONT, camera, latest, raw
from tests.services.detector.support.views import NEAR_VIEWS, near_view

SCRIPT = (PEERS / "rospy_depth_camera.py").read_text(encoding="utf-8")
MS = 1_000_000


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def frames(samples: Subscription, count: int) -> list[ImageFrame]:
    return [await receive(samples, ImageFrame) for _ in range(count)]


@pytest.mark.timeout(120)
async def test_colour_and_depth_are_thinned_to_the_same_instants_and_compressed(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    await (await ros.script(SCRIPT)).until_output("camera up")
    depth_topic = ("--topics", "front/depth=/front/depth/image_raw")
    await rig.gateway("r1", ros.master_uri, {"front": CAMERAS["front"]}, *depth_topic, "--max-hz", "10")
    async with (
        rig.subscribed(FRONT.stream(Stream.COLOR)) as color_samples,
        rig.subscribed(FRONT.stream(Stream.DEPTH)) as depth_samples,
    ):
        first_depth = await receive(depth_samples, ImageFrame)
        color = await frames(color_samples, 30)
        depth = [first_depth, *await frames(depth_samples, 14)]
        status = await rig.stream_status("r1", "front", lambda status: status.compression == "jpeg:80")
    assert [frame.header.seq for frame in color] == list(range(30))
    instants = [frame.header.stamp_ns for frame in color]
    assert instants[-1] - instants[0] > 29 * 90 * MS
    both = [frame for frame in depth if instants[0] < frame.header.stamp_ns < instants[-1]]
    assert len(both) >= 8
    assert {frame.header.stamp_ns - 2 * MS for frame in both} <= set(instants)
    assert {(frame.format, frame.encoding, frame.step) for frame in color} == {("jpeg", "rgb8", 960)}
    assert {(frame.format, frame.encoding, frame.step) for frame in depth} == {("zstd", "16UC1", 640)}
    numbers = [struct.unpack_from("<H", zstd.decompress(frame.data))[0] for frame in depth]
    assert numbers == sorted(set(numbers))
    assert status.dropped[THINNED] > status.forwarded
    assert status.bytes < status.forwarded * 10_000


@pytest.mark.timeout(120)
async def test_a_replay_of_an_hour_ago_beside_a_live_camera_is_thinned_with_it(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    for name, behind_s in (("live", 0), ("replay", 3_600)):
        await (await ros.script(OFF_CAMERA, name, CAMERAS["front"], str(behind_s))).until_output("camera up")
    await rig.gateway("r1", ros.master_uri, {"front": CAMERAS["front"]}, "--max-hz", "5")
    async with rig.subscribed(FRONT.stream(Stream.COLOR)) as samples:
        await rig.stream_status("r1", "front", lambda status: status.publishers == 2)
        headers = [frame.header for frame in await frames(samples, 40)]
    took_s = (headers[-1].received_ns - headers[0].received_ns) / 1e9
    assert len(headers) <= 5 * took_s + 1 + 5 * BURST_S


@pytest.mark.timeout(120)
async def test_what_patterns_leave_is_scaled_and_sent_as_png(ros: RosEnvironment, rig: FleetRig) -> None:
    await (await ros.script(SCRIPT)).until_output("camera up")
    patterns = ("--allow", "/front/.*", "--deny", ".*/depth/.*")
    await rig.gateway("r1", ros.master_uri, {}, *patterns, "--scale", "*/color=1/2", "--compression", "*/color=png")
    found = await rig.stream_topics("r1", bool)
    assert found == {"front/color": CAMERAS["front"]}
    async with rig.subscribed(FRONT.stream(Stream.COLOR)) as samples:
        frame = await receive(samples, ImageFrame)
    assert (frame.format, frame.encoding, frame.height, frame.width, frame.step) == ("png", "rgb8", 120, 160, 480)
    assert picture_of(frame.data).format == "png"


@pytest.mark.timeout(180)
async def test_a_detector_here_gets_raw_frames_and_one_elsewhere_makes_them_jpeg_for_both(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    (view, *_) = NEAR_VIEWS
    await rig.gateway("r1", ros.master_uri, {"front": CAMERAS["front"]})
    await rig.start("detector")
    await camera(ros, CAMERAS["front"], [raw(tmp_path, "near.raw", near_view(view), "bgr8")])
    async with rig.subscribed(FRONT.stream(Stream.CLASSES)) as classes:
        await receive(classes, ClassList)
        await rig.stream_status("r1", "front", lambda status: status.compression == "raw")
        elsewhere = Wanted(StreamKey(CameraKey("r1", "front"), Stream.COLOR), "another-machine", "w9")
        async with rig.bus.announce(str(elsewhere)):
            await rig.stream_status("r1", "front", lambda status: status.compression == "jpeg:80")
            async with rig.subscribed(FRONT.stream(Stream.CLASSES)) as later:
                names = {seen.name for seen in (await latest(later)).classes}
    assert view.classes <= names
