"""Nodes that take another's name, and tools that end nodes, at Debian's real master."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from gateway.ros1.node import Node
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from tests.integration.fleet import fleet_rig, receive
from tests.integration.peers.ros import require_ros
from tests.integration.peers.rospy_scripts import GREY_CAMERA, LISTENER, TALKER
from tests.waiting import PATIENCE_S, until

if TYPE_CHECKING:
    from bus import Subscription
    from gateway.ros1.tcpros.subscriber import Message
    from tests.integration.peers.ros import RosEnvironment

FRONT = CameraKey("r1", "front")
TOPIC = "/front/color/image_raw"
STRING = "std_msgs/String"
ROSNODE = "/usr/bin/rosnode"


async def seen(frames: Subscription, grey: int) -> None:
    """Wait until a frame of this grey has come."""
    while (await receive(frames, ImageFrame)).data[0] != grey:
        pass


async def test_a_gateway_whose_name_is_taken_goes_on_under_another_and_ends_when_rosnode_kills_it(
    ros: RosEnvironment,
) -> None:
    require_ros(ROSNODE)
    async with fleet_rig() as rig, rig.subscribed(FRONT.stream(Stream.COLOR)) as frames:
        await (await ros.script(GREY_CAMERA, "camera", TOPIC, "10")).until_output("camera up")
        gateway = await rig.gateway(
            "r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw", "--node-name", "sensors"
        )
        await seen(frames, 10)
        thief = await ros.script(LISTENER, "sensors", "/chat")
        await thief.until_output("listener up")
        async with asyncio.timeout(PATIENCE_S):
            while "/sensors_2" not in await nodes(ros):  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.1)
        await (await ros.script(GREY_CAMERA, "camera_2", TOPIC, "20")).until_output("camera up")
        await seen(frames, 20)
        await seen(frames, 10)
        await ros.script(TALKER, "talker", "/chat", "10")
        await thief.until_output("heard talker")
        assert gateway.process.returncode is None
        killed = await ros.run(ROSNODE, "kill", "/sensors_2")
        assert "killed" in await killed.finished()
        async with asyncio.timeout(PATIENCE_S):
            assert await gateway.process.wait() == 1
        assert "/sensors_2" not in await nodes(ros)
        assert "/sensors" in await nodes(ros)


async def nodes(ros: RosEnvironment) -> list[str]:
    """Return the nodes that the master knows."""
    return (await (await ros.run(ROSNODE, "list")).finished()).split()


async def test_a_node_under_its_next_name_is_known_by_it_on_its_links_both_ways(ros: RosEnvironment) -> None:
    got: list[Message] = []
    async with (
        Node("/a", master_uri=ros.master_uri, poll_interval=60) as node,
        node.advertise("/out", STRING, latch=True) as publication,
        node.subscribe("/in", STRING, got.append),
    ):
        publication.publish(b"\5\0\0\0hello")
        await until(lambda: node.registered, "it is registered")
        for name in ("/a_2", "/a_3"):  # the second thief takes the first one's place, and the third name is free
            await ros.script(LISTENER, node.name.strip("/"), "/in")
            await until(lambda: node.name == name and node.registered, "it has its next name")  # noqa: B023
        state = await node.master.get_system_state()
        assert state.publishers["/out"] == ("/a_3",)
        assert sorted(state.subscribers["/in"]) == ["/a", "/a_2", "/a_3"]
        assert await node.master.lookup_node("/a_3") == node.uri
        listener = await ros.script(LISTENER, "listener", "/out")
        await listener.until_output("heard hello")
        await ros.script(TALKER, "talker", "/in", "10")
        await until(lambda: got, "the message has come")
        uri = await node.master.lookup_node("/talker")
        links = await node._client.call(uri, "getBusInfo", "/test")
        assert "/a_3" in [row[1] for row in links if row[4] == "/in"]
        assert not node.shutdown_requested.is_set()


async def test_a_name_that_others_have_already_is_passed_over(ros: RosEnvironment) -> None:
    async with (
        Node("/a", master_uri=ros.master_uri, poll_interval=60) as node,
        Node("/a_2", master_uri=ros.master_uri) as other,
        node.advertise("/out", STRING),
        other.advertise("/other", STRING),
    ):
        await until(lambda: node.registered and other.registered, "both are registered")
        async with Node("/a", master_uri=ros.master_uri) as thief, thief.advertise("/stolen", STRING):
            await until(lambda: node.name == "/a_3" and node.registered, "it has a free name")
            state = await node.master.get_system_state()
            assert (state.publishers["/out"], state.publishers["/other"]) == (("/a_3",), ("/a_2",))
            assert (other.name, thief.name) == ("/a_2", "/a")
            assert state.publishers["/stolen"] == ("/a",)
