"""Messages as odd drivers send them, from Debian's rospy through a real gateway to a subscriber on Zenoh."""

from collections.abc import AsyncIterator, Callable
from typing import Any

import numpy as np
import pytest

from gateway.ros1.image import TYPE_NAME as IMAGE
from gateway.ros1.image import Image, encode_image
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import MALFORMED
from schemas import keys
from schemas.codec import Message as OurMessage
from schemas.image import ImageFrame
from schemas.points import PointCloud
from schemas.transforms import Transforms
from tests.gateway.sensing import compressed, point_cloud, received, tf, transform
from tests.gateway.to_bus.translators.rvl_coding import rvl_of
from tests.gateway.to_bus.translators.test_cloud_image import RGB, UNORDERED, colored
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import PEERS, RosEnvironment, require_ros
from tests.schemas.pictures import file_of
from tests.waiting import until

SCRIPT = (PEERS / "rospy_bytes.py").read_text(encoding="utf-8")
DEPTH = np.array([[0, 1, 2310], [65535, 500, 8000]], np.uint16)
UYVY = np.arange(12, dtype=np.uint8).reshape(3, 4)


def image(encoding: str, rows: np.ndarray[Any, Any], width: int, height: int) -> Message:
    step = width * rows.itemsize * (2 if encoding == "yuv422_yuy2" else 1)
    fields = Image(1, 2, 3, "lens", height, width, encoding, False, step, memoryview(rows.tobytes()))  # noqa: FBT003
    return received(IMAGE, encode_image(fields))


def in_latin_1(message: Message) -> Message:
    return message._replace(data=bytes(message.data).replace(b"K?ste", b"K\xe4ste"))


def holds_depth(frame: ImageFrame) -> bool:
    return (frame.encoding, bytes(frame.data)) == ("16UC1", DEPTH.tobytes())


def holds_file(frame: ImageFrame) -> bool:
    return (frame.encoding, frame.format, bytes(frame.data)) == ("16UC1", "png", file_of(DEPTH, ".png"))


def holds_uyvy(frame: ImageFrame) -> bool:
    return (frame.encoding, bytes(frame.data)) == ("yuv422", UYVY.tobytes())


def holds_points(cloud: PointCloud) -> bool:
    return (cloud.width, cloud.row_step, bytes(cloud.data)) == (6, 48, bytes(range(48)))


def holds_children(*children: str) -> Callable[[Transforms], bool]:
    return lambda found: [each.child_frame_id for each in found.transforms] == list(children)


SENT: dict[str, tuple[str, Message, type[OurMessage], Callable[[Any], bool]]] = {
    "lidar/points": ("/lidar/points", point_cloud(height=1, width=6, row_step=24), PointCloud, holds_points),
    "tf": (
        "/tf",
        in_latin_1(tf(transform("K?ste"), transform("lens"))),
        Transforms,
        holds_children("K\ufffdste", "lens"),
    ),
    "a/depth": ("/a/depth", image("mono16", DEPTH, 3, 2), ImageFrame, holds_depth),
    "b/depth": (
        "/b/depth",
        compressed("16UC1; compressedDepth rvl", bytes(12) + rvl_of(DEPTH)),
        ImageFrame,
        holds_depth,
    ),
    "c/depth": ("/c/depth", compressed("16UC1; compressedDepth png", file_of(DEPTH, ".png")), ImageFrame, holds_file),
    "d/depth": ("/d/depth", compressed("png", bytes(12) + file_of(DEPTH, ".png")), ImageFrame, holds_file),
    "e/color": (
        "/e/color",
        image("yuv422_yuy2", UYVY.view(np.uint16).byteswap().view(np.uint8), 2, 3),
        ImageFrame,
        holds_uyvy,
    ),
}


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def publish(ros: RosEnvironment, messages: dict[str, Message]) -> None:
    require_ros("tf2_msgs")
    said = (f"{topic}={sent.publisher.type.name}:{bytes(sent.data).hex()}" for topic, sent in messages.items())
    await (await ros.script(SCRIPT, *said)).until_output("bytes up")


@pytest.mark.timeout(180)
async def test_what_odd_drivers_send_arrives_as_it_is_meant(ros: RosEnvironment, rig: FleetRig) -> None:
    await publish(ros, {topic: message for topic, message, *_ in SENT.values()})
    named = [option for name, (topic, *_) in SENT.items() for option in ("--topics", f"{name}={topic}")]
    await rig.gateway("r1", ros.master_uri, {}, *named, "--compression", "raw", "--no-results")
    for name, (_, _, schema, holds) in SENT.items():
        async with rig.subscribed(str(keys.sensor_key("r1", name))) as samples:
            assert holds(await receive(samples, schema)), name
    lidar = await rig.stream_status("r1", "lidar", lambda of: of.forwarded > 0)
    assert lidar.repaired == lidar.forwarded
    assert MALFORMED not in lidar.dropped


POINTS = "/camera/depth/color/points"


async def offered(rig: FleetRig, *streams: str) -> None:
    """Wait until exactly these streams are offered, all of the cloud."""
    whole = {f"camera/{stream}": POINTS for stream in streams}
    await rig.stream_topics("r1", lambda topics: topics == whole)


@pytest.mark.timeout(180)
async def test_a_driver_of_unordered_clouds_alone_is_no_camera(
    ros: RosEnvironment, rig: FleetRig, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    await rig.gateway("r1", ros.master_uri, {}, "--compression", "raw")
    await publish(ros, {POINTS: UNORDERED})
    said = f"{POINTS}: its points are not an image, so its camera gets no colour stream from them"
    await until(lambda: said in caplog.text, "the gateway has looked")
    async with rig.subscribed("fleet/r1/camera/points") as clouds:
        assert (await receive(clouds, PointCloud)).width == 6
        await offered(rig, "points")


@pytest.mark.timeout(180)
async def test_a_driver_of_organised_clouds_is_a_camera(ros: RosEnvironment, rig: FleetRig) -> None:
    await rig.gateway("r1", ros.master_uri, {}, "--compression", "raw")
    await publish(ros, {POINTS: colored(row_step=0)})
    async with rig.subscribed("fleet/r1/camera/color") as pictures:
        frame = await receive(pictures, ImageFrame)
        assert (frame.height, frame.width, bytes(frame.data)) == (2, 3, RGB.tobytes())
        await offered(rig, "color", "points")
