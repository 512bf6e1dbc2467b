"""A camera on Debian's real ROS 1 becomes a class list: rosmaster, rospy or rosbag, gateway, detector, subscriber."""

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer

from bus import Subscription
from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.messages import message_type
from gateway.to_bus.stream import MALFORMED
from schemas.detections import ClassList, Detections
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import PEERS, RosEnvironment, RosProcess
from tests.services.detector.support.views import NEAR_VIEWS, near_view

FRONT, REAR = CameraKey("r1", "front"), CameraKey("r1", "rear")
CAMERAS = {"front": "/front/color/image_raw", "rear": "/rear/color/image_raw"}
SCRIPT = (PEERS / "rospy_camera.py").read_text(encoding="utf-8")


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


def raw(folder: Path, name: str, bgr: NDArray[np.uint8], encoding: str = "rgb8") -> str:
    """Write an image's pixels; return it as the camera script's argument."""
    code = {"rgb8": cv2.COLOR_BGR2RGB, "bgra8": cv2.COLOR_BGR2BGRA, "mono8": cv2.COLOR_BGR2GRAY}.get(encoding)
    pixels = bgr if code is None else cv2.cvtColor(bgr, code)
    (folder / name).write_bytes(np.ascontiguousarray(pixels).tobytes())
    return f"{folder / name}:{bgr.shape[1]}:{bgr.shape[0]}:{encoding}"


async def camera(ros: RosEnvironment, topic: str, images: Sequence[str], hz: float = 5) -> RosProcess:
    started = await ros.script(SCRIPT, topic, str(hz), *images)
    await started.until_output("camera up")
    return started


def photographs() -> list[NDArray[np.uint8]]:
    """Return the photographs inside the Ultralytics package."""
    found = [cv2.imread(str(path)) for path in sorted(Path(str(files("ultralytics") / "assets")).glob("*.jpg"))]
    assert found
    return [np.asarray(image, np.uint8) for image in found if image is not None]


@pytest.mark.timeout(180)
async def test_photographs_from_rospy_become_class_lists_with_their_own_stamps(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    images = [raw(tmp_path, f"{n}.rgb", photograph) for n, photograph in enumerate(photographs())]
    before_ns = time.time_ns()
    await camera(ros, CAMERAS["front"], images)
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    await rig.start("detector")
    async with rig.subscribed(FRONT.stream(Stream.CLASSES)) as classes:
        lists = [await receive(classes, ClassList) for _ in range(2 * len(images))]
    assert all(before_ns < seen.header.stamp_ns < seen.header.received_ns for seen in lists)
    assert {seen.header.frame_id for seen in lists} == {"camera_color_optical_frame"}
    assert [seen.header.seq for seen in lists] == sorted({seen.header.seq for seen in lists})


@pytest.mark.timeout(180)
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "bgra8"])
async def test_near_objects_are_named_right_whatever_the_colour_order(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path, encoding: str
) -> None:
    views = list(NEAR_VIEWS)
    images = [raw(tmp_path, f"{n}.raw", near_view(view), encoding) for n, view in enumerate(views)]
    await rig.gateway("r1", ros.master_uri, {"front": CAMERAS["front"]})
    await rig.start("detector")
    for view, image in zip(views, images, strict=True):
        showing = await camera(ros, CAMERAS["front"], [image])
        async with rig.subscribed(FRONT.stream(Stream.CLASSES)) as classes:
            names = {seen.name for seen in (await latest(classes)).classes}
        assert view.classes <= names
        await showing.end()


async def latest(classes: Subscription) -> ClassList:
    """Return a class list of the frame shown now: the one kept for late subscribers may be of the one before."""
    seen = [await receive(classes, ClassList) for _ in range(3)]
    return seen[-1]


@pytest.mark.timeout(180)
async def test_a_bag_played_by_rosbag_becomes_detections(ros: RosEnvironment, rig: FleetRig, tmp_path: Path) -> None:
    view = next(iter(NEAR_VIEWS))
    bag = tmp_path / "drive.bag"
    write_bag(bag, CAMERAS["front"], near_view(view), count=20)
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    await rig.start("detector")
    async with rig.subscribed(FRONT.stream(Stream.DETECTIONS)) as detections:
        await ros.run("/usr/bin/rosbag", "play", "--loop", "--quiet", str(bag))
        found = await receive(detections, Detections)
    assert (found.height, found.width) == (480, 640)
    assert view.classes <= {each.name for each in found.objects}
    assert all(each.mask is not None for each in found.objects)


def write_bag(path: Path, topic: str, bgr: NDArray[np.uint8], count: int) -> None:
    kind = message_type(TYPE_NAME)
    with Writer(path) as writer:
        connection = writer.add_connection(topic, "sensor_msgs/msg/Image", msgdef=kind.definition, md5sum=kind.md5sum)
        for number in range(count):
            stamp_ns = 1_700_000_000_000_000_000 + number * 100_000_000
            stamp_s, rest_ns = divmod(stamp_ns, 1_000_000_000)
            message = Image(
                seq=number,
                stamp_s=stamp_s,
                stamp_ns=rest_ns,
                frame_id="lens",
                height=bgr.shape[0],
                width=bgr.shape[1],
                encoding="bgr8",
                is_bigendian=False,
                step=bgr.shape[1] * 3,
                data=bgr.data.cast("B"),
            )
            writer.write(connection, stamp_ns, encode_image(message))


@pytest.mark.timeout(120)
async def test_ros_is_subscribed_only_while_somebody_on_zenoh_wants_the_stream(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    await camera(ros, CAMERAS["front"], [raw(tmp_path, "x", np.zeros((4, 6, 3), np.uint8))], hz=20)
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    assert (await rig.stream_status("r1", "front")).received == 0
    assert "Subscribers: None" in await (await ros.rostopic("info", CAMERAS["front"])).finished()
    async with rig.subscribed(FRONT.stream(Stream.COLOR)) as frames:
        assert (await receive(frames, ImageFrame)).height == 4
        assert "fleetsight_gateway_r1" in await (await ros.rostopic("info", CAMERAS["front"])).finished()
        await rig.stream_status("r1", "front", lambda status: status.wanted and status.publishers == 1)
    async with asyncio.timeout(20):
        while "Subscribers: None" not in await (await ros.rostopic("info", CAMERAS["front"])).finished():
            pass
    await rig.stream_status("r1", "front", lambda status: not status.wanted and status.publishers == 0)


@pytest.mark.timeout(120)
async def test_malformed_images_are_counted_and_harm_nobody(ros: RosEnvironment, rig: FleetRig, tmp_path: Path) -> None:
    good = raw(tmp_path, "good", np.zeros((4, 6, 3), np.uint8))
    path = tmp_path / "good"
    bad = [f"{path}:6:5:rgb8", f"{path}:6:4:rgb9", f"{path}:4000000000:4000000000:mono8", f"{path}:0:0:rgb8"]
    await camera(ros, CAMERAS["front"], [good, *bad], hz=20)
    await camera(ros, CAMERAS["rear"], [good], hz=20)
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    async with (
        rig.subscribed(FRONT.stream(Stream.COLOR)) as front,
        rig.subscribed(REAR.stream(Stream.COLOR)) as rear,
    ):
        frames = [await receive(front, ImageFrame) for _ in range(3)]
        assert [(frame.height, frame.header.seq) for frame in frames] == [(4, 0), (4, 1), (4, 2)]
        assert (await receive(rear, ImageFrame)).height == 4
        status = await rig.stream_status("r1", "front", lambda status: status.dropped.get(MALFORMED, 0) >= 8)
        assert set(status.dropped) == {MALFORMED}
        assert (await rig.stream_status("r1", "rear", lambda status: status.received > 0)).dropped == {}
