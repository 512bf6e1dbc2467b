"""Pictures of 72 MB from Debian's rospy, through a real gateway and real Zenoh sockets."""

from collections.abc import AsyncIterator

import pytest

from gateway.ros1.tcpros.subscriber import LinkFailure
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import RosEnvironment
from tests.integration.peers.rospy_scripts import LARGE_CAMERA
from tests.integration.ros_graph.test_doctor import doctor

CAMERAS = {"front": "/front/color/image_raw"}
FRONT = CameraKey("r1", "front").stream(Stream.COLOR)
WIDTH, HEIGHT = 6_000, 4_000
LONGER = ("--seconds", "8")
"""On a busy machine a picture of this size takes longer than the time for which the doctor of other tests listens."""


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def camera(ros: RosEnvironment) -> None:
    started = await ros.script(LARGE_CAMERA, CAMERAS["front"], str(WIDTH), str(HEIGHT))
    await started.until_output("camera up")


@pytest.mark.timeout(180)
async def test_a_picture_of_24_megapixels_arrives_and_the_doctor_finds_it_well(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    await camera(ros)
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--compression", "raw", "--no-shared-memory")
    async with rig.subscribed(FRONT) as samples:
        frame = await receive(samples, ImageFrame)
    assert (frame.width, frame.height, frame.encoding, frame.format) == (WIDTH, HEIGHT, "rgb8", "raw")
    assert (frame.data.nbytes, bytes(frame.data[:3]), bytes(frame.data[-3:])) == (72_000_000, b"abc", b"abc")
    report = await doctor(ros.master_uri, CAMERAS, rig.endpoint, *LONGER)
    assert (report.code, report.problems) == (0, []), report.findings
    assert "72.00 MB each" in report.said("front/color", "ok")


@pytest.mark.timeout(180)
async def test_one_over_the_limit_is_told_with_its_size_and_the_option_that_lets_it_through(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    limit = ("--max-message-mib", "64")
    await camera(ros)
    await rig.gateway("r1", ros.master_uri, CAMERAS, *limit)
    async with rig.subscribed(FRONT):
        status = await rig.stream_status("r1", "front", lambda of: "--max-message-mib" in of.problem)
        report = await doctor(ros.master_uri, CAMERAS, rig.endpoint, *limit)
    assert status.broken_links.keys() == {LinkFailure.TOO_LARGE}
    assert "a message of 72,000,041 bytes, over the limit of 67,108,864" in status.problem
    assert report.code == 1
    assert report.said("front/color").startswith("/camera sends a message of 72,000,041 bytes, over the limit of 67,1")
    (advice,) = {each["advice"] for each in report.findings if "sends a message of" in each["what"]}
    assert (
        advice
        == "give the gateway --max-message-mib 69 or more, or have the driver send smaller or compressed messages"
    )
