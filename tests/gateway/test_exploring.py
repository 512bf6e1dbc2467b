"""An explorer at an embedded ROS master: what is published there is offered on a fake bus."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from bus.fake import FakeNetwork
from gateway.discovery import DiscoverySettings
from gateway.discovery.published_topics import TopicHistory
from gateway.exploring import Explorer
from gateway.node_names import node_name
from gateway.offers import Offers
from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.node import Node
from gateway.ros1.tcpros.publisher import Publication
from gateway.settings import GatewaySettings
from schemas.keys import CameraKey, SensorKey, Stream, StreamKey
from services.simulator.ros_master.master import RosMaster
from services.toolbox.demo.children import free_ports
from tests.gateway.offering import new_offers
from tests.gateway.to_bus.translators.test_cloud_image import EMPTY, UNORDERED, colored
from tests.waiting import until

FRONT = StreamKey(CameraKey("r1", "front"), Stream.COLOR)
FRONT_TOPIC, REAR_TOPIC = "/front/color/image_raw", "/rear/color/image_raw"
POINTS = "sensor_msgs/PointCloud2"


class Rig:
    def __init__(self, node: Node, explorer: Explorer, offers: Offers) -> None:
        self.node = node
        self.explorer = explorer
        self.offers = offers

    async def until_offered(self, *topics: str) -> None:
        """Wait until exactly these topics are offered."""
        await until(lambda: {stream.topic for stream in self.offers.streams()} == set(topics), f"offered: {topics}")

    async def until_streams(self, *names: str) -> None:
        """Wait until exactly the streams with these names are planned."""
        await until(lambda: {key.name for key in self.explorer.plan.streams} == set(names), f"planned: {names}")


async def until_subscribers(publication: Publication, count: int) -> None:
    """Wait until so many listen."""
    await until(lambda: publication.subscriber_count == count, f"{count} listen")


@asynccontextmanager
async def exploring(
    master_uri: str, named: dict[SensorKey, str] | None = None, hold_s: float = 0.3, *, discover: bool = True
) -> AsyncIterator[Rig]:
    async with (
        FakeNetwork().open_bus() as bus,
        Node(f"/{node_name('r1', '0')}", master_uri=master_uri, poll_interval=0.05) as node,
        asyncio.TaskGroup() as group,
    ):
        offers = new_offers(group, bus, node)
        settings = GatewaySettings(robot="r1", rectified=["rear/color"])
        explorer = Explorer(node, DiscoverySettings("r1", named or {}, discover), settings.unused, TopicHistory(hold_s))
        await explorer.begin(offers)
        task = group.create_task(explorer.run(offers))
        yield Rig(node, explorer, offers)
        task.cancel()
        await asyncio.wait([task])
        await offers.close()


@pytest.fixture
async def master() -> AsyncIterator[RosMaster]:
    async with RosMaster() as running:
        yield running


@pytest.mark.parametrize("discover", [True, False])
async def test_that_naming_streams_ends_discovery_is_said(
    master: RosMaster, caplog: pytest.LogCaptureFixture, *, discover: bool
) -> None:
    caplog.set_level("INFO")
    async with exploring(master.uri, {FRONT: FRONT_TOPIC}, discover=discover) as rig:
        await rig.until_offered(FRONT_TOPIC)
    said = "only the streams that the settings name are offered; --discover finds others as well"
    assert caplog.messages.count(said) == (not discover)


async def test_what_appears_is_offered_and_what_stays_away_withdrawn(
    master: RosMaster, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    async with exploring(master.uri) as rig, Node("/camera", master_uri=master.uri) as camera:
        assert rig.explorer.waiting_for == "a camera, a lidar or transforms on the ROS graph"
        async with camera.advertise(FRONT_TOPIC, TYPE_NAME):
            await rig.until_offered(FRONT_TOPIC)
            assert rig.explorer.waiting_for == ""
            assert caplog.messages.count("no such stream: --rectified rear/color") == 1
            async with camera.advertise(REAR_TOPIC, TYPE_NAME):
                await rig.until_offered(FRONT_TOPIC, REAR_TOPIC)
            await rig.until_offered(FRONT_TOPIC)
        await rig.until_offered()
    for line in (
        "front/color: /front/color/image_raw (sensor_msgs/Image)",
        "rear/color: no longer offered, /rear/color/image_raw is gone",
        "waiting for a camera, a lidar or transforms on the ROS graph",
    ):
        assert line in caplog.messages


async def test_a_node_that_restarts_keeps_its_streams(master: RosMaster) -> None:
    async with exploring(master.uri, hold_s=600) as rig, Node("/rear", master_uri=master.uri) as rear:
        for _ in range(2):
            async with Node("/front", master_uri=master.uri) as front, front.advertise(FRONT_TOPIC, TYPE_NAME):
                await rig.until_offered(FRONT_TOPIC)
        async with rear.advertise(REAR_TOPIC, TYPE_NAME):
            await rig.until_offered(FRONT_TOPIC, REAR_TOPIC)


async def test_a_topic_of_another_type_is_planned_anew(master: RosMaster) -> None:
    async with (
        exploring(master.uri) as rig,
        Node("/camera", master_uri=master.uri) as camera,
        camera.advertise("/front/image_raw", TYPE_NAME),
        camera.advertise(FRONT_TOPIC, TYPE_NAME),
    ):
        await rig.until_offered(FRONT_TOPIC)
        async with Node("/other", master_uri=master.uri) as other, other.advertise(FRONT_TOPIC, POINTS):
            await rig.until_offered("/front/image_raw")


async def test_a_node_that_comes_back_at_once_with_another_type_is_noticed(master: RosMaster) -> None:
    async with exploring(master.uri) as rig, Node("/camera", master_uri=master.uri) as camera:
        await camera.master.register_publisher(FRONT_TOPIC, TYPE_NAME, camera.uri)
        await rig.until_offered(FRONT_TOPIC)
        await camera.master.register_publisher(FRONT_TOPIC, POINTS, camera.uri)
        await rig.until_offered()


async def test_gateways_publications_are_nobodys_sensors(master: RosMaster) -> None:
    async with (
        exploring(master.uri) as rig,
        Node(f"/{node_name('r2', '1')}", master_uri=master.uri) as gateway,
        Node("/camera", master_uri=master.uri) as camera,
        gateway.advertise("/seen/image_raw", TYPE_NAME),
        camera.advertise(FRONT_TOPIC, TYPE_NAME),
    ):
        await rig.until_offered(FRONT_TOPIC)
        await until(lambda: "/seen/image_raw" in rig.explorer.plan.left_out, "the other gateway's topic is seen")
        assert rig.explorer.plan.left_out["/seen/image_raw"] == "published by gateways"


async def test_what_is_named_is_offered_without_a_master_and_what_it_knows_with_one() -> None:
    port = free_ports(1)
    named: dict[SensorKey, str] = {FRONT: FRONT_TOPIC}
    async with exploring(f"http://127.0.0.1:{port}", named) as rig:
        await rig.until_offered(FRONT_TOPIC)
        assert rig.explorer.waiting_for == ""
        async with (
            RosMaster(port=port) as master,
            Node("/camera", master_uri=master.uri) as camera,
            camera.advertise(REAR_TOPIC, TYPE_NAME),
        ):
            await rig.until_offered(FRONT_TOPIC, REAR_TOPIC)


async def test_a_master_that_restarts_or_stays_away_withdraws_nothing() -> None:
    port = free_ports(1)
    async with AsyncExitStack() as stack:
        async with RosMaster(port=port) as master:
            camera = await stack.enter_async_context(Node("/camera", master_uri=master.uri, poll_interval=600))
            await stack.enter_async_context(camera.advertise(FRONT_TOPIC, TYPE_NAME))
            rig = await stack.enter_async_context(exploring(master.uri, hold_s=0.1))
            await rig.until_offered(FRONT_TOPIC)
            await until(lambda: rig.node.publications() and rig.node.registered, "the master has taken results' topics")
        await asyncio.sleep(0.3)
        await rig.until_offered(FRONT_TOPIC)
        other = await stack.enter_async_context(RosMaster(port=port))
        late = await stack.enter_async_context(Node("/late", master_uri=other.uri))
        async with late.advertise(REAR_TOPIC, TYPE_NAME):
            await rig.until_offered(FRONT_TOPIC, REAR_TOPIC)
        await rig.until_offered(FRONT_TOPIC)


def picture(encoding: str) -> bytes:
    return encode_image(Image(1, 1, 0, "lens", 1, 2, encoding, is_bigendian=False, step=8, data=memoryview(bytes(8))))


async def test_depth_is_found_by_its_pixels_and_listened_to_no_longer_than_that(master: RosMaster) -> None:
    depth, color = "/oak/stereo/image_raw", "/oak/rgb/image_raw"
    async with (
        exploring(master.uri, hold_s=600) as rig,
        Node("/oak", master_uri=master.uri) as oak,
        oak.advertise(color, TYPE_NAME),
        oak.advertise(depth, TYPE_NAME) as publication,
    ):
        await until(lambda: publication.subscriber_count == 1, "it is looked at")
        while not {"oak/depth"} & {key.name for key in rig.explorer.plan.streams}:
            publication.publish(picture("16UC1"))
            await asyncio.sleep(0.01)
        assert {key.name: source.topic for key, source in rig.explorer.plan.streams.items()} == {
            "oak/color": color,
            "oak/depth": depth,
        }
        await until(lambda: publication.subscriber_count == 0, "it is looked at no longer")


async def test_a_name_counts_while_nothing_is_sent_and_pixels_as_soon_as_something_is(master: RosMaster) -> None:
    topic = "/oak/stereo/image_raw"
    async with (
        exploring(master.uri, hold_s=600) as rig,
        Node("/oak", master_uri=master.uri) as oak,
        oak.advertise(topic, TYPE_NAME) as publication,
    ):
        await until(lambda: [key.name for key in rig.explorer.plan.streams] == ["stereo/color"], "by its name")
        publication.publish(picture("32FC1"))
        await until(lambda: [key.name for key in rig.explorer.plan.streams] == ["stereo/depth"], "by its pixels")


async def test_a_topic_that_is_gone_is_listened_to_no_longer(master: RosMaster) -> None:
    async with exploring(master.uri, hold_s=0.1) as rig, Node("/oak", master_uri=master.uri) as oak:
        async with oak.advertise("/oak/image_raw", TYPE_NAME):
            await until(lambda: "/oak/image_raw" in rig.node.subscriptions(), "it is listened to")
        await until(lambda: "/oak/image_raw" not in rig.node.subscriptions(), "it is not")


async def test_pixels_are_looked_at_again_when_a_driver_is_started_anew_and_count_until_then(
    master: RosMaster,
) -> None:
    topic = "/oak/stereo/image_raw"

    def offered() -> list[str]:
        return [key.name for key in rig.explorer.plan.streams]

    async with exploring(master.uri, hold_s=600) as rig:
        for encoding, name, before in (
            ("mono8", "stereo/color", []),
            ("16UC1", "stereo/depth", ["stereo/color"]),
            ("mono8", "stereo/color", ["stereo/depth"]),
        ):
            async with Node("/driver", master_uri=master.uri) as driver, driver.advertise(topic, TYPE_NAME) as sent:
                await until_subscribers(sent, 1)
                assert offered() == before
                sent.publish(picture(encoding))
                await rig.until_streams(name)
                await until_subscribers(sent, 0)
            await until(lambda: topic not in rig.explorer.published, "the master has forgotten it")
            assert offered() == [name]


async def test_pixels_are_looked_at_again_when_another_node_publishes_them(master: RosMaster) -> None:
    topic = "/oak/stereo/image_raw"
    async with exploring(master.uri, hold_s=600) as rig, AsyncExitStack() as stack:
        for encoding, name in (("mono8", "stereo/color"), ("16UC1", "stereo/depth")):
            node = await stack.enter_async_context(Node(f"/{name}", master_uri=master.uri))
            sent = await stack.enter_async_context(node.advertise(topic, TYPE_NAME))
            await until_subscribers(sent, 1)
            sent.publish(picture(encoding))
            await rig.until_streams(name)


async def test_clouds_are_looked_at_again_when_a_driver_is_started_anew(master: RosMaster) -> None:
    topic = "/camera/depth/color/points"

    async with exploring(master.uri, hold_s=600) as rig:
        for cloud, streams in (
            (UNORDERED, ["camera/points"]),
            (colored(), ["camera/color", "camera/points"]),
            (UNORDERED, ["camera/points"]),
        ):
            async with Node("/driver", master_uri=master.uri) as driver, driver.advertise(topic, POINTS) as sent:
                await until_subscribers(sent, 1)
                sent.publish(bytes(cloud.data))
                await until_subscribers(sent, 0)
                await rig.until_streams(*streams)
            await until(lambda: topic not in rig.explorer.published, "the master has forgotten it")


async def test_a_driver_of_unordered_clouds_has_no_colour_until_it_is_started_anew(
    master: RosMaster, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    topic = "/camera/depth/color/points"

    def offered() -> list[str]:
        return [status.stream for status in rig.offers.streams()]

    async with exploring(master.uri) as rig, Node("/realsense", master_uri=master.uri) as driver:
        async with driver.advertise(topic, POINTS) as publication:
            await until(lambda: publication.subscriber_count == 1, "its name promises colour")
            for cloud in (b"", bytes(EMPTY.data)):  # they tell nothing
                publication.publish(cloud)
            publication.publish(bytes(UNORDERED.data))
            await until(lambda: publication.subscriber_count == 0, "its clouds are no pictures")
            await asyncio.sleep(0.2)
            assert offered() == ["points"]
        await until(lambda: not offered(), "the topic is gone")
        async with driver.advertise(topic, POINTS) as publication:
            await until(lambda: publication.subscriber_count == 1, "its name promises colour again")
            publication.publish(bytes(colored().data))
            await until(lambda: offered() == ["color", "points"], "its clouds are pictures")
            await until(lambda: publication.subscriber_count == 0, "it is listened to no longer")
    assert (
        caplog.messages.count(f"{topic}: its points are not an image, so its camera gets no colour stream from them")
        == 1
    )
    assert "camera/color: /camera/depth/color/points (sensor_msgs/PointCloud2)" in caplog.messages


async def test_a_cloud_is_listened_to_no_longer_when_it_is_gone(master: RosMaster) -> None:
    async with exploring(master.uri) as rig, Node("/realsense", master_uri=master.uri) as driver:
        async with driver.advertise("/camera/rgb/points", POINTS) as publication:
            await until(lambda: publication.subscriber_count == 1, "it is listened to")
        await until(lambda: not rig.node.subscriptions(), "it is listened to no longer")


async def test_no_cloud_is_listened_to_while_an_image_may_be_the_colour(master: RosMaster) -> None:
    image, points = "/camera/image_raw", "/camera/rgb/points"
    async with (
        exploring(master.uri, hold_s=600) as rig,
        Node("/driver", master_uri=master.uri) as driver,
        driver.advertise(points, POINTS) as cloud,
        driver.advertise(image, TYPE_NAME) as publication,
    ):
        await until(lambda: publication.subscriber_count == 1, "the image is looked at")
        await rig.until_offered(points)
        await asyncio.sleep(0.2)
        assert points not in rig.node.subscriptions()
        while len(rig.explorer.plan.streams) == 1:
            publication.publish(picture("rgb8"))
            await asyncio.sleep(0.01)
        assert {key.name: source.topic for key, source in rig.explorer.plan.streams.items()} == {
            "camera/color": image,
            "camera/points": points,
        }
        await asyncio.sleep(0.2)
        assert cloud.subscriber_count == 0
        assert points not in rig.node.subscriptions()
