"""A gateway's streams between an embedded ROS master and a fake bus."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import numpy as np
import pytest

from bus import QUEUE, Bus, Subscription
from bus.fake import FakeNetwork
from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.node import Node
from gateway.to_bus.forward import Forward, offering
from gateway.to_bus.stream import MALFORMED, StreamForward
from gateway.to_bus.subscriptions import Subscriptions
from gateway.to_bus.translators import kind_of
from schemas import codec
from schemas.image import ImageFrame
from schemas.keys import CameraKey, RobotStreamKey, SensorKey, Stream, StreamKey
from schemas.status import UNWANTED
from schemas.transforms import Transforms
from services.simulator.ros_master.master import RosMaster
from tests.gateway.sensing import compressed, tf, transform
from tests.schemas.pictures import file_of
from tests.waiting import PATIENCE_S, until

FRONT = CameraKey("r1", "front")
COLOR = StreamKey(FRONT, Stream.COLOR)
TOPIC = "/front/color/image_raw"
STATIC = RobotStreamKey("r1", "tf_static")
LINGER_S = 0.05
TOPICS: dict[SensorKey, str] = {COLOR: TOPIC, STATIC: "/tf_static"}


def message(seq: int) -> bytes:
    return encode_image(
        Image(
            seq=seq,
            stamp_s=1,
            stamp_ns=seq,
            frame_id="lens",
            height=2,
            width=2,
            encoding="rgb8",
            is_bigendian=False,
            step=6,
            data=memoryview(bytes(12)),
        )
    )


class Rig:
    def __init__(self, bus: Bus, camera: Node, lidar: Node, forward: Forward, static: Forward) -> None:
        self.bus = bus
        self.camera = camera
        self.lidar = lidar
        self.forward = forward
        self.static = static


async def receive(subscription: Subscription) -> ImageFrame:
    async with asyncio.timeout(PATIENCE_S):
        sample = await anext(subscription)
    return codec.decode(ImageFrame, sample.payload, sample.encoding)


@pytest.fixture
def linger_s() -> float:
    return LINGER_S


@pytest.fixture
async def rig(linger_s: float) -> AsyncIterator[Rig]:
    """A camera node, a lidar node and a gateway's streams at one master; the test is the rest of the fleet."""
    network = FakeNetwork()
    async with AsyncExitStack() as stack:
        theirs = await stack.enter_async_context(network.open_bus())
        ours = await stack.enter_async_context(network.open_bus())
        master = await stack.enter_async_context(RosMaster())
        camera = await stack.enter_async_context(Node("/camera", master_uri=master.uri))
        node = await stack.enter_async_context(Node("/gateway", master_uri=master.uri, poll_interval=0.2))
        lidar = await stack.enter_async_context(Node("/lidar", master_uri=master.uri))
        streams = [StreamForward(key, topic, kind_of(key), "boot") for key, topic in TOPICS.items()]
        color, static = [
            await stack.enter_async_context(offering(ours, stream, linger_s=linger_s)) for stream in streams
        ]
        topics = Subscriptions(node)
        running = [asyncio.create_task(forward.run(topics)) for forward in (color, static)]
        yield Rig(theirs, camera, lidar, color, static)
        for task in running:
            task.cancel()
        await asyncio.wait(running)


async def test_a_stream_is_present_but_not_subscribed_until_wanted(rig: Rig) -> None:
    async with rig.bus.watch("fleet/*/*/color/alive") as watch, rig.camera.advertise(TOPIC, TYPE_NAME) as publication:
        assert (await anext(watch)).key == FRONT.alive(Stream.COLOR)
        await asyncio.sleep(0.3)
        assert publication.subscriber_count == 0
        assert rig.forward.status().wanted is False


async def test_frames_flow_while_wanted_and_the_subscription_ends_after(rig: Rig) -> None:
    async with rig.camera.advertise(TOPIC, TYPE_NAME) as publication:
        async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as frames:
            await until(lambda: publication.subscriber_count == 1)
            await until(lambda: rig.forward.status().publishers == 1)
            for seq in (4, 5):
                publication.publish(message(seq))
                frame = await receive(frames)
                assert (frame.header.stamp_ns, frame.header.seq) == (1_000_000_000 + seq, seq - 4)
        await until(lambda: publication.subscriber_count == 0)
    status = rig.forward.status()
    assert (status.wanted, status.publishers, status.received, status.forwarded) == (False, 0, 2, 2)


async def test_wanted_before_there_is_a_publisher(rig: Rig) -> None:
    async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as frames:
        await until(lambda: rig.forward.status().wanted)
        async with rig.camera.advertise(TOPIC, TYPE_NAME) as publication:
            await until(lambda: publication.subscriber_count == 1)
            publication.publish(message(0))
            assert (await receive(frames)).header.seq == 0


async def test_wanted_again_numbers_count_on(rig: Rig) -> None:
    async with rig.camera.advertise(TOPIC, TYPE_NAME) as publication:
        for expected in (0, 1):
            async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as frames:
                await until(lambda: publication.subscriber_count == 1)
                publication.publish(message(0))
                assert (await receive(frames)).header.seq == expected
            await until(lambda: publication.subscriber_count == 0)


async def test_a_malformed_message_does_not_stop_the_stream(rig: Rig, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        async with (
            rig.camera.advertise(TOPIC, TYPE_NAME) as publication,
            rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as frames,
        ):
            await until(lambda: publication.subscriber_count == 1)
            publication.publish(b"garbage")
            await until(lambda: rig.forward.status().dropped)
            publication.publish(message(1))
            assert (await receive(frames)).header.stamp_ns == 1_000_000_001
    assert rig.forward.status().dropped == {MALFORMED: 1}
    assert f"{TOPIC} from /camera: message left out" in caplog.text


async def test_a_publisher_that_breaks_off_is_counted_even_after_the_subscription_ended(rig: Rig) -> None:
    async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)):
        async with rig.camera.advertise(TOPIC, TYPE_NAME) as publication:
            await until(lambda: publication.subscriber_count == 1)
        await until(lambda: rig.forward.status().broken_links)
        counted = rig.forward.status().broken_links
    await until(lambda: rig.forward.subscription is None)
    assert rig.forward.status().broken_links == counted


async def frames_told(samples: Subscription) -> set[str]:
    async with asyncio.timeout(PATIENCE_S):
        sample = await anext(samples)
    sent = codec.decode(Transforms, sample.payload, sample.encoding)
    return {found.child_frame_id for found in sent.transforms}


async def frames_until(samples: Subscription, whole: set[str]) -> None:
    while await frames_told(samples) != whole:
        pass


@pytest.mark.parametrize("other_kind", ["tf2_msgs/TFMessage", "tf/tfMessage"])
async def test_static_transforms_of_two_latched_publishers_are_whole_for_whoever_comes_late(
    rig: Rig, other_kind: str
) -> None:
    async with (
        rig.bus.watch(STATIC.alive) as watch,
        rig.camera.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True) as lens,
        rig.lidar.advertise("/tf_static", other_kind, latch=True) as beam,
    ):
        assert (await anext(watch)).alive
        lens.publish(bytes(tf(transform("lens")).data))
        beam.publish(bytes(tf(transform("beam")).data))
        async with rig.bus.subscribe(str(STATIC), QUEUE(9)) as first:
            await frames_until(first, {"lens", "beam"})
            async with rig.bus.subscribe(str(STATIC), QUEUE(9)) as late:
                await frames_until(late, {"lens", "beam"})
    status = rig.static.status()
    assert (status.camera, status.stream, status.received) == ("", "tf_static", status.forwarded)


async def pause(rig: Rig) -> None:
    await until(lambda: not rig.static.demand.wanted)
    await asyncio.sleep(2 * LINGER_S)


async def test_what_one_publisher_latched_one_after_another_is_whole_after_every_pause(rig: Rig) -> None:
    async with rig.camera.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True) as nodelets:
        await until(lambda: nodelets.subscriber_count == 1)
        for said in (["camera"], ["camera", "lidar"], ["camera", "lidar", "mast"]):
            await pause(rig)
            received = rig.static.status().received
            nodelets.publish(bytes(tf(transform(said[-1])).data))
            await until(lambda received=received: rig.static.status().received > received)  # type: ignore[misc]
            async with rig.bus.subscribe(str(STATIC), QUEUE(9)) as samples:
                await until(lambda: rig.static.status().wanted)
                # kept before, and handed over anew by the publisher
                assert [await frames_told(samples) for _ in range(2)] == [set(said)] * 2


async def test_what_a_publisher_said_that_has_gone_is_told_no_longer_after_a_pause(rig: Rig) -> None:
    async with rig.camera.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True) as lens:
        lens.publish(bytes(tf(transform("lens")).data))
        async with rig.bus.subscribe(str(STATIC), QUEUE(9)) as samples:
            async with rig.lidar.advertise("/tf_static", "tf2_msgs/TFMessage", latch=True) as beam:
                beam.publish(bytes(tf(transform("beam")).data))
                await frames_until(samples, {"lens", "beam"})
            lens.publish(bytes(tf(transform("lens", x=1)).data))
            assert await frames_told(samples) == {"lens", "beam"}
        await pause(rig)
        async with rig.bus.subscribe(str(STATIC), QUEUE(9)) as samples:
            await frames_until(samples, {"lens"})


async def test_latched_pictures_of_two_publishers_reach_every_late_subscriber(rig: Rig) -> None:
    async with (
        rig.camera.advertise(TOPIC, TYPE_NAME, latch=True) as floor,
        rig.lidar.advertise(TOPIC, TYPE_NAME, latch=True) as ceiling,
    ):
        floor.publish(message(1))
        ceiling.publish(message(2))
        async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as first:
            assert {(await receive(first)).header.stamp_ns for _ in range(2)} == {1_000_000_001, 1_000_000_002}
            async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as late:
                assert {(await receive(late)).header.stamp_ns for _ in range(2)} == {1_000_000_001, 1_000_000_002}
            floor.publish(message(3))
            assert (await receive(first)).header.stamp_ns == 1_000_000_003
            async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as later:
                assert {(await receive(later)).header.stamp_ns for _ in range(2)} == {1_000_000_002, 1_000_000_003}
    status = rig.forward.status()
    assert (status.received, status.forwarded, status.dropped) == (3, 3, {})


async def test_what_a_publisher_latched_is_kept_no_longer_when_it_has_gone(rig: Rig) -> None:
    async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as first:
        async with rig.camera.advertise(TOPIC, TYPE_NAME, latch=True) as floor:
            floor.publish(message(1))
            await receive(first)
        await until(lambda: rig.forward.subscription and not rig.forward.subscription.counters.links)
        await asyncio.sleep(0.05)
        async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as late:
            assert late.counts.received == 0


@pytest.mark.parametrize("linger_s", [1000])
async def test_a_demand_that_blinks_does_not_end_the_subscription_and_meanwhile_nothing_is_sent(rig: Rig) -> None:
    async with rig.camera.advertise(TOPIC, TYPE_NAME) as publication:
        async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as frames:
            await until(lambda: publication.subscriber_count == 1)
            publication.publish(message(0))
            await receive(frames)
            begun = rig.forward.subscription
        for seq in (1, 2):
            await until(lambda: not rig.forward.publisher.wanted)
            publication.publish(message(seq))
            await until(lambda seq=seq: rig.forward.status().dropped == {UNWANTED: seq})  # type: ignore[misc]
            async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as frames:
                await until(lambda: rig.forward.publisher.wanted)
                publication.publish(message(9))
                assert (await receive(frames)).header.seq == seq
            assert rig.forward.subscription is begun
        assert publication.subscriber_count == 1
    assert rig.forward.publisher.counts.put == 3


async def test_a_topic_that_changes_its_type_goes_on(rig: Rig) -> None:
    jpeg = file_of(np.zeros((4, 6, 3), np.uint8), ".jpg")
    async with rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as frames:
        async with rig.camera.advertise(TOPIC, TYPE_NAME) as publication:
            await until(lambda: publication.subscriber_count == 1)
            publication.publish(message(0))
            assert (await receive(frames)).format == "raw"
        picture = compressed("jpeg", jpeg)
        async with rig.lidar.advertise(TOPIC, picture.publisher.type.name) as publication:
            await until(lambda: publication.subscriber_count == 1)
            publication.publish(bytes(picture.data))
            assert (await receive(frames)).format == "jpeg"


async def test_a_publisher_that_the_stream_cannot_carry_costs_only_its_own_link_and_is_told_of(rig: Rig) -> None:
    async with (
        rig.lidar.advertise(TOPIC, "std_msgs/String"),
        rig.bus.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as frames,
    ):
        await until(lambda: rig.forward.status().broken_links)
        problem = rig.forward.status().problem
        assert problem.startswith(f"{rig.lidar.uri}: type mismatch: {TOPIC} is std_msgs/String [")
        assert problem.endswith("expected sensor_msgs/Image or sensor_msgs/CompressedImage")
        async with rig.camera.advertise(TOPIC, TYPE_NAME) as publication:
            await until(lambda: publication.subscriber_count == 1)
            publication.publish(message(0))
            assert (await receive(frames)).header.stamp_ns == 1_000_000_000
    await until(lambda: not rig.forward.subscription)
    assert rig.forward.status().problem == ""
