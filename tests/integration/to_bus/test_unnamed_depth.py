"""A real rospy node whose depth is named like any picture, as OAK-D names it: known by its pixels."""

from collections.abc import AsyncIterator

import pytest

from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import RosEnvironment
from tests.integration.peers.rospy_scripts import OAK
from tests.integration.ros_graph.test_doctor import doctor

DEPTH_TOPIC = "/oak/stereo/image_raw"
STREAMS = {
    "color": "/oak/rgb/image_raw",
    "depth": DEPTH_TOPIC,
    "info": "/oak/rgb/camera_info",
    "depth_info": "/oak/stereo/camera_info",
}


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    ("camera", "options"),
    [("oak", ()), ("front", ("--topics", f"front/depth={DEPTH_TOPIC}", "--discover"))],
    ids=["found", "named by hand beside what is found"],
)
async def test_depth_and_colour_are_one_camera(
    ros: RosEnvironment, rig: FleetRig, camera: str, options: tuple[str, ...]
) -> None:
    await (await ros.script(OAK)).until_output("camera up")
    await rig.gateway("r1", ros.master_uri, {}, *options)
    expected = {f"{camera}/{stream}": topic for stream, topic in STREAMS.items()}
    assert await rig.stream_topics("r1", lambda topics: len(topics) >= len(STREAMS)) == expected
    async with rig.subscribed(CameraKey("r1", camera).stream(Stream.DEPTH)) as samples:
        assert (await receive(samples, ImageFrame)).encoding == "16UC1"
    report = await doctor(ros.master_uri, {}, rig.endpoint, *options)
    assert (report.code, report.problems) == (0, [])
    assert "messages/s" in report.said(f"{camera}/depth", "ok")


@pytest.mark.timeout(120)
async def test_depth_that_is_named_as_colour_is_a_problem(ros: RosEnvironment, rig: FleetRig) -> None:
    await (await ros.script(OAK)).until_output("camera up")
    await rig.gateway("r1", ros.master_uri, {"front": DEPTH_TOPIC})
    await rig.stream_status("r1", "front")
    report = await doctor(ros.master_uri, {"front": DEPTH_TOPIC}, rig.endpoint)
    assert report.code == 1
    said = "/oak sends depth, which is used as colour: 16UC1 pixels are depth, not colour"
    assert report.said("front/color") == said
    (advice,) = [each["advice"] for each in report.findings if each["what"] == said]
    assert advice == f"name it as depth: --topics front/depth={DEPTH_TOPIC}"
