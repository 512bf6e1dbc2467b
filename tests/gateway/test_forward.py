"""A gateway's streams between an embedded ROS master and a fake bus."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack

import pytest

from bus import QUEUE, Bus, Subscription
from bus.fake import FakeNetwork
from gateway.forward import Forward, offering
from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.node import Node
from gateway.ros1.rosmaster import RosMaster
from gateway.stream import MALFORMED, StreamForward
from gateway.translators import kind_of
from schemas import codec
from schemas.image import ImageFrame
from schemas.keys import CameraKey, RobotStreamKey, SensorKey, Stream, StreamKey
from schemas.transforms import Transforms
from tests.gateway.sensing import tf, transform

FRONT = CameraKey("r1", "front")
COLOR = StreamKey(FRONT, Stream.COLOR)
TOPIC = "/front/color/image_raw"
STATIC = RobotStreamKey("r1", "tf_static")
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


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(10):
        while not condition():  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.01)


async def receive(subscription: Subscription) -> ImageFrame:
    async with asyncio.timeout(10):
        sample = await anext(subscription)
    return codec.decode(ImageFrame, sample.payload, sample.encoding)


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
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
        color, static = [await stack.enter_async_context(offering(ours, stream)) for stream in streams]
        running = [asyncio.create_task(forward.run(node)) for forward in (color, static)]
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
    async with asyncio.timeout(10):
        sample = await anext(samples)
    sent = codec.decode(Transforms, sample.payload, sample.encoding)
    return {found.child_frame_id for found in sent.transforms}


async def test_static_transforms_of_two_latched_publishers_are_whole_for_whoever_comes_late(rig: Rig) -> None:
    kind = "tf2_msgs/TFMessage"
    async with (
        rig.bus.watch(STATIC.alive) as watch,
        rig.camera.advertise("/tf_static", kind, latch=True) as lens,
        rig.lidar.advertise("/tf_static", kind, latch=True) as beam,
    ):
        assert (await anext(watch)).alive
        lens.publish(bytes(tf(transform("lens")).data))
        beam.publish(bytes(tf(transform("beam")).data))
        async with rig.bus.subscribe(str(STATIC), QUEUE(9)) as first:
            told = [await frames_told(first) for _ in range(2)]
            assert told[1] == {"lens", "beam"}
            async with rig.bus.subscribe(str(STATIC), QUEUE(9)) as late:
                assert await frames_told(late) == {"lens", "beam"}
        await until(lambda: lens.subscriber_count == beam.subscriber_count == 0)
    status = rig.static.status()
    assert (status.camera, status.stream, status.received, status.forwarded) == ("", "tf_static", 2, 2)
