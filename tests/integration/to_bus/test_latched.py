"""What real rospy publishers latched, for whoever subscribes on Zenoh, whenever that is."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from rosbags.rosbag1 import Writer

from bus import Subscription
from gateway.ros1.messages import deserialise, message_type
from gateway.to_bus.forward import LINGER_S
from schemas.image import ImageFrame
from schemas.keys import sensor_key
from schemas.ros import RawMessage
from schemas.transforms import Transforms
from tests.gateway.sensing import tf, transform
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import RosEnvironment, RosProcess, require_ros
from tests.integration.peers.rospy_scripts import PICTURE, STATIC_FRAME, STATIC_FRAMES, TALKER

CAMERAS = {"floor": "/floor/image_raw"}


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def latched(ros: RosEnvironment, script: str, *arguments: str) -> RosProcess:
    started = await ros.script(script, *arguments)
    await started.until_output("latched")
    return started


async def frames_until(samples: Subscription, whole: set[str]) -> None:
    """Wait until a message holds these frames and no others."""
    while {found.child_frame_id for found in (await receive(samples, Transforms)).transforms} != whole:
        pass


async def greys(samples: Subscription, count: int) -> set[int]:
    frames = [await receive(samples, ImageFrame) for _ in range(count)]
    assert {len(frame.data) for frame in frames} == {1_000_000}
    return {frame.data[0] for frame in frames}


async def test_static_transforms_are_whole_for_whoever_joins_when(ros: RosEnvironment, rig: FleetRig) -> None:
    require_ros("tf2_msgs")
    key = str(sensor_key("r1", "tf_static"))
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--topics", "tf_static=/tf_static")
    async with rig.subscribed(key) as early:
        lens = await latched(ros, STATIC_FRAME, "lens")
        await frames_until(early, {"lens"})
        await latched(ros, STATIC_FRAME, "beam")
        await frames_until(early, {"lens", "beam"})
        async with rig.subscribed(key) as late:
            await frames_until(late, {"lens", "beam"})
        lens.kill()
        await latched(ros, STATIC_FRAME, "mast")
        await frames_until(early, {"lens", "beam", "mast"})
        async with rig.subscribed(key) as later:
            await frames_until(later, {"lens", "beam", "mast"})


async def paused(rig: FleetRig, received: int) -> int:
    """Wait until nobody has wanted static transforms, of which so many came, for long; return how many were sent."""
    status = await rig.stream_status("r1", "", lambda of: not of.wanted and of.received >= received)
    await asyncio.sleep(LINGER_S)
    return status.forwarded


async def test_static_transforms_of_a_node_with_several_broadcasters_are_whole_after_a_pause(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    require_ros("tf2_msgs")
    key, whole = str(sensor_key("r1", "tf_static")), {"lens", "beam", "mast"}
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--topics", "tf_static=/tf_static")
    await latched(ros, STATIC_FRAMES, *sorted(whole))  # which nobody wants yet
    for pauses in range(2):
        forwarded = await paused(rig, len(whole) + pauses)
        async with rig.subscribed(key) as samples:
            seq = -1
            while seq < forwarded:  # until it is one that the node handed over anew
                sent = await receive(samples, Transforms)
                assert {found.child_frame_id for found in sent.transforms} == whole
                seq = sent.header.seq


async def test_pictures_of_two_publishers_reach_every_late_subscriber(ros: RosEnvironment, rig: FleetRig) -> None:
    key = str(sensor_key("r1", "floor/color"))
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--compression", "raw")
    lower = await latched(ros, PICTURE, "lower", CAMERAS["floor"], "10")
    await latched(ros, PICTURE, "upper", CAMERAS["floor"], "20")
    async with rig.subscribed(key) as first:
        assert await greys(first, 2) == {10, 20}
        async with rig.subscribed(key) as second:
            assert await greys(second, 2) == {10, 20}
        await lower.end()
        await latched(ros, PICTURE, "lower", CAMERAS["floor"], "30")
        assert await greys(first, 1) == {30}
        async with rig.subscribed(key) as third:
            assert await greys(third, 2) == {20, 30}


async def test_an_untranslated_topic_says_that_it_is_latched(ros: RosEnvironment, rig: FleetRig) -> None:
    key = str(sensor_key("r1", "ros/mode"))
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--topics", "ros/mode=/mode")
    await ros.script(TALKER, "talker", "/mode", "0.01", "latched")
    async with rig.subscribed(key) as first:
        await receive(first, RawMessage)
        async with rig.subscribed(key) as late:
            kept = await receive(late, RawMessage)
    assert (kept.latched, deserialise(kept.type, kept.data).data) == (True, "talker 0")


async def test_a_bag_played_by_roscpp_latches_what_several_nodes_had_latched(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    bag = tmp_path / "static.bag"
    with Writer(bag) as writer:
        for place, child in enumerate(("lens", "beam")):
            said = tf(transform(child))
            kind = message_type(said.publisher.type.name)
            connection = writer.add_connection(
                "/tf_static",
                "tf2_msgs/msg/TFMessage",
                msgdef=kind.definition,
                md5sum=kind.md5sum,
                callerid=f"/{child}",
                latching=1,
            )
            writer.write(connection, 1_700_000_000_000_000_000 + place, bytes(said.data))
    key = str(sensor_key("r1", "tf_static"))
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--topics", "tf_static=/tf_static")
    async with rig.subscribed(key) as early:
        await ros.run("/usr/bin/rosbag", "play", "--keep-alive", "--quiet", str(bag))
        await frames_until(early, {"lens", "beam"})
        async with rig.subscribed(key) as late:
            await frames_until(late, {"lens", "beam"})
    await rig.gateway("r2", ros.master_uri, CAMERAS, "--topics", "tf_static=/tf_static", "--no-results")
    async with rig.subscribed(str(sensor_key("r2", "tf_static"))) as of_another_gateway:
        await frames_until(of_another_gateway, {"lens", "beam"})
