"""Our nodes among rospy's, at Debian's real master."""

from __future__ import annotations

import asyncio
import hashlib
import signal
from typing import TYPE_CHECKING

from gateway.ros1.image import Image, decode_image, encode_image
from gateway.ros1.messages import deserialise, new_message, serialise
from gateway.ros1.node import Node
from gateway.ros1.tcpros.subscriber import LinkFailure, Message
from tests.integration.peers.rospy_scripts import CAMERA, IMAGE_LISTENER, LISTENER, TALKER
from tests.waiting import until

if TYPE_CHECKING:
    import pytest

    from gateway.ros1.tcpros.publisher import Publication
    from tests.integration.peers.ros import RosEnvironment

PIXELS = bytes(i % 251 for i in range(480 * 1920))
STRING = "std_msgs/String"


def texts(messages: list[Message]) -> list[str]:
    return [deserialise(STRING, message.data).data for message in messages]


def text(data: str) -> bytes:
    return serialise(STRING, new_message(STRING, data=data))


async def publish_until(publication: Publication, message: bytes, heard: asyncio.Task[None]) -> None:
    while not heard.done():
        publication.publish(message)
        await asyncio.sleep(0.05)
    heard.result()


async def test_image_of_a_rospy_publisher_arrives_as_it_was_sent(ros: RosEnvironment) -> None:
    got: list[Message] = []
    async with (
        Node("/ours", master_uri=ros.master_uri) as node,
        node.subscribe("/camera/image_raw", "sensor_msgs/Image", got.append),
    ):
        await ros.script(CAMERA, "/camera/image_raw", "20")
        await until(lambda: len(got) >= 3, "three images have come")
    image = decode_image(got[0].data)
    assert got[0].callerid == "/camera"
    assert (image.width, image.height, image.step, image.encoding) == (640, 480, 1920, "rgb8")
    assert (image.frame_id, image.stamp) == ("front", 1_700_000_000_123_456_789)
    assert image.data == PIXELS
    assert [decode_image(message.data).seq for message in got[:3]] == [image.seq, image.seq + 1, image.seq + 2]


async def test_rospy_subscriber_gets_our_image_as_it_was_sent(ros: RosEnvironment) -> None:
    image = Image(1, 1_700_000_000, 5, "front", 480, 640, "bgr8", False, 1920, memoryview(PIXELS))  # noqa: FBT003
    async with (
        Node("/ours", master_uri=ros.master_uri) as node,
        node.advertise("/overlay", "sensor_msgs/Image") as publication,
    ):
        listener = await ros.script(IMAGE_LISTENER, "/overlay")
        expected = f"image 640 480 bgr8 front 1700000000000000005 {hashlib.sha256(PIXELS).hexdigest()}"
        heard = asyncio.ensure_future(listener.until_output(expected))
        await publish_until(publication, encode_image(image), heard)
        assert publication.subscriber_count == 1


async def test_rostopic_shows_us_and_echoes_us(ros: RosEnvironment) -> None:
    async with (
        Node("/ours", master_uri=ros.master_uri) as node,
        node.advertise("/classes", STRING, latch=True) as publication,
        node.subscribe("/other", STRING, lambda _: None),
    ):
        publication.publish(text("['box', 'pallet']"))
        await until(lambda: node.registered, "the node is registered")
        listed = await (await ros.rostopic("list", "-v")).finished()
        assert "/classes [std_msgs/String] 1 publisher" in listed
        assert "/other [std_msgs/String] 1 subscriber" in listed
        info = await (await ros.rostopic("info", "/classes")).finished()
        assert f"/ours ({node.uri})" in info
        echoed = await (await ros.rostopic("echo", "-n", "1", "/classes")).finished()
        assert "['box', 'pallet']" in echoed
    state = await (await ros.rostopic("list")).finished()
    assert "/classes" not in state
    assert "/other" not in state


async def test_killed_publisher_does_not_delay_a_live_one_listed_after_it(ros: RosEnvironment) -> None:
    dead = await ros.script(TALKER, "dead", "/chatter", "50")
    got: list[Message] = []
    async with Node("/ours", master_uri=ros.master_uri, poll_interval=0.5) as node:
        await dead.until_output("talker up")
        await until_registered(node, "/chatter", {"/dead"})
        dead.kill()
        await ros.script(TALKER, "live", "/chatter", "50")
        await until_registered(node, "/chatter", {"/dead", "/live"})
        async with node.subscribe("/chatter", STRING, got.append) as subscription:
            await until(lambda: len(got) >= 5, "the live publisher is heard")
            await until(lambda: subscription.counters.failures[LinkFailure.UNREACHABLE] >= 2, "the dead one is retried")
    assert {message.callerid for message in got} == {"/live"}


async def until_registered(node: Node, topic: str, names: set[str]) -> None:
    async with asyncio.timeout(20):
        while set((await node.master.get_system_state()).publishers.get(topic, ())) != names:  # noqa: ASYNC110
            await asyncio.sleep(0.05)


async def test_publisher_that_restarts_on_another_port_is_heard_again(ros: RosEnvironment) -> None:
    got: list[Message] = []
    async with (
        Node("/ours", master_uri=ros.master_uri, poll_interval=0.5) as node,
        node.subscribe("/chatter", STRING, got.append),
    ):
        first = await ros.script(TALKER, "talker", "/chatter", "50")
        await until(lambda: got, "the first talker is heard")
        await first.end(signal.SIGKILL)
        got.clear()
        await ros.script(TALKER, "talker", "/chatter", "50")
        await until(lambda: got, "the second talker is heard")
    assert texts(got)[0].startswith("talker ")


async def test_registrations_come_back_after_the_master_was_killed(ros: RosEnvironment) -> None:
    got: list[Message] = []
    async with (
        Node("/ours", master_uri=ros.master_uri, poll_interval=0.2) as node,
        node.subscribe("/chatter", STRING, got.append),
        node.advertise("/classes", STRING),
    ):
        await until(lambda: node.registered, "the node is registered")
        await ros.end_master()
        await until(lambda: not node.registered, "the master's end is noticed")
        await ros.start_master()
        await until_registered(node, "/classes", {"/ours"})
        await ros.script(TALKER, "talker", "/chatter", "50")
        await until(lambda: got, "a talker of the new master is heard")


async def test_node_waits_for_a_master_that_is_not_there_yet(
    ros: RosEnvironment, caplog: pytest.LogCaptureFixture
) -> None:
    await ros.end_master()
    got: list[Message] = []
    async with (
        Node("/ours", master_uri=ros.master_uri, poll_interval=0.2) as node,
        node.subscribe("/chatter", STRING, got.append),
    ):
        await until(lambda: "waiting for the ROS master" in caplog.text, "it says what it waits for")
        await ros.start_master()
        await ros.script(TALKER, "talker", "/chatter", "50")
        await until(lambda: got, "a talker is heard")


async def test_publisher_of_another_type_is_refused_and_counted(ros: RosEnvironment) -> None:
    got: list[Message] = []
    await ros.script(TALKER, "talker", "/camera/image_raw", "50")
    async with (
        Node("/ours", master_uri=ros.master_uri) as node,
        node.subscribe("/camera/image_raw", "sensor_msgs/Image", got.append) as subscription,
    ):
        await until(lambda: subscription.counters.failures[LinkFailure.REFUSED], "the publisher has refused us")
    assert not got


async def test_subscription_to_any_type_learns_the_type(ros: RosEnvironment) -> None:
    got: list[Message] = []
    await ros.script(TALKER, "talker", "/chatter", "50")
    async with (
        Node("/ours", master_uri=ros.master_uri) as node,
        node.subscribe("/chatter", "*", got.append) as subscription,
    ):
        await until(lambda: got, "the talker is heard")
        assert subscription.type.name == STRING
    assert got[0].publisher.definition.startswith("string data")


async def test_latched_message_of_ours_reaches_a_rospy_listener_that_comes_late(ros: RosEnvironment) -> None:
    async with (
        Node("/ours", master_uri=ros.master_uri) as node,
        node.advertise("/chatter", STRING, latch=True) as publication,
    ):
        publication.publish(text("kept"))
        listener = await ros.script(LISTENER, "listener", "/chatter")
        await listener.until_output("heard kept")
