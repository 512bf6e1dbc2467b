"""Gateways that are told nothing but their robot's name, on Debian's real ROS 1."""

from base64 import b64encode
from collections.abc import AsyncIterator

import numpy as np
import pytest

from schemas.camera_info import CameraInfo
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from tests.gateway.test_exploring import exploring
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import RosEnvironment, RosProcess
from tests.integration.peers.rospy_scripts import SENSORS
from tests.schemas.pictures import file_of
from tests.waiting import until

CAMERA = CameraKey("r1", "camera")
REALSENSE = {
    "/camera/color/image_raw": "Image",
    "/camera/color/camera_info": "CameraInfo",
    "/camera/aligned_depth_to_color/image_raw": "Image",
    "/camera/aligned_depth_to_color/camera_info": "CameraInfo",
    "/camera/depth/image_rect_raw": "Image",
    "/camera/depth/color/points": "PointCloud2",
    "/camera/infra1/image_rect_raw": "Image",
}
STREAMS = {
    "camera/color": "/camera/color/image_raw",
    "camera/depth": "/camera/aligned_depth_to_color/image_raw",
    "camera/depth_info": "/camera/aligned_depth_to_color/camera_info",
    "camera/info": "/camera/color/camera_info",
    "camera/points": "/camera/depth/color/points",
}
REAR = {"/rear/color/image_raw": "Image"}
FRONT_BOTH_WAYS = {"/front/color/image_raw": "Image", "/front/color/image_raw/compressed": "CompressedImage"}
JPEG = file_of(np.zeros((4, 6, 3), np.uint8), ".jpg")
COMPRESSED = {"/rear/color/image_raw/compressed": "CompressedImage"}


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def sensors(ros: RosEnvironment, name: str, topics: dict[str, str]) -> RosProcess:
    """Start a rospy node that publishes these types on these topics."""
    started = await ros.script(
        SENSORS, name, b64encode(JPEG).decode(), *(f"{topic}={kind}" for topic, kind in topics.items())
    )
    await started.until_output("sensors up")
    return started


@pytest.mark.timeout(120)
async def test_a_robots_name_is_enough(ros: RosEnvironment, rig: FleetRig) -> None:
    await sensors(ros, "realsense", REALSENSE)
    await rig.gateway("r2", ros.master_uri, {"only": "/never"})
    await rig.return_status("r2", "only")
    await rig.gateway("r1", ros.master_uri, {})
    assert await rig.stream_topics("r1", lambda topics: len(topics) >= len(STREAMS)) == STREAMS
    async with rig.subscribed(CAMERA.stream(Stream.COLOR)) as frames:
        assert (await receive(frames, ImageFrame)).encoding == "rgb8"
    async with rig.subscribed(CAMERA.stream(Stream.INFO)) as infos:
        assert (await receive(infos, CameraInfo)).width == 2
    assert (await rig.return_status("r1", "camera")).topic.startswith("/ultralytics/detection/")
    await sensors(ros, "rear", REAR)
    both = {**STREAMS, "rear/color": "/rear/color/image_raw"}
    assert await rig.stream_topics("r1", lambda topics: len(topics) > len(STREAMS)) == both
    assert (await rig.return_status("r1", "rear")).topic.startswith("/ultralytics/rear/detection/")


@pytest.mark.timeout(120)
async def test_what_is_gone_is_withdrawn_unless_its_master_was_restarted(ros: RosEnvironment) -> None:
    front, rear = "/camera/color/image_raw", "/rear/color/image_raw"
    async with exploring(ros.master_uri) as rig:
        await sensors(ros, "front", {front: "Image"})
        leaving = await sensors(ros, "rear", REAR)
        await rig.until_offered(front, rear)
        await leaving.end()
        await rig.until_offered(front)
        await until(lambda: rig.node.registered, "the master has taken the results' topics")
        await ros.end_master()
        await ros.start_master()
        coming = await sensors(ros, "rear", REAR)
        await rig.until_offered(front, rear)
        await coming.end()
        await rig.until_offered(front)


@pytest.mark.timeout(120)
async def test_a_picture_that_is_sent_raw_and_compressed_is_one_stream(ros: RosEnvironment, rig: FleetRig) -> None:
    await sensors(ros, "front", FRONT_BOTH_WAYS)
    await sensors(ros, "rear", COMPRESSED)
    await rig.gateway("r1", ros.master_uri, {})
    raw, compressed = "/front/color/image_raw", "/rear/color/image_raw/compressed"
    found = await rig.stream_topics("r1", lambda topics: len(topics) >= 2)
    assert found == {"front/color": raw, "rear/color": compressed}
    async with rig.subscribed(CameraKey("r1", "rear").stream(Stream.COLOR)) as frames:
        frame = await receive(frames, ImageFrame)
    assert (frame.format, frame.height, frame.width, bytes(frame.data)) == ("jpeg", 4, 6, JPEG)


@pytest.mark.timeout(120)
async def test_a_gateway_waits_for_its_master_and_for_sensors_and_says_so(ros: RosEnvironment, rig: FleetRig) -> None:
    await ros.end_master()
    await rig.gateway("r1", ros.master_uri, {})
    said = await rig.gateway_status("r1")
    assert said.waiting_for == f"the ROS master at {ros.master_uri.rstrip('/')}"
    await ros.start_master()
    await rig.gateway_status("r1", lambda status: status.waiting_for.startswith("a camera, "))
    await sensors(ros, "camera", {"/camera/color/image_raw": "Image"})
    await rig.gateway_status("r1", lambda status: not status.waiting_for)
    async with rig.subscribed(CAMERA.stream(Stream.COLOR)) as frames:
        assert (await receive(frames, ImageFrame)).encoding == "rgb8"
