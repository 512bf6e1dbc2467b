"""What is offered on a fake bus follows a plan, between an embedded ROS master and the test."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from bus import QUEUE, Bus
from bus.fake import FakeNetwork
from gateway.discovery.plan import NO_PLAN, Plan, Source
from gateway.offers import MAX_RETURNED, Offers
from gateway.ros1.image import TYPE_NAME
from gateway.ros1.names import Names
from gateway.ros1.node import Node
from gateway.to_bus.stream import MALFORMED
from gateway.to_ros.outputs import STRING, camera_returns
from schemas import codec
from schemas.image import ImageFrame
from schemas.keys import CameraKey, SensorKey, Stream, StreamKey
from schemas.points import PointCloud
from services.simulator.ros_master.master import RosMaster
from tests.gateway.offering import Returned, new_offers, returned_in_root
from tests.gateway.to_bus.test_forward import message
from tests.gateway.to_bus.translators.test_cloud_image import colored
from tests.waiting import until

FRONT, REAR = (CameraKey("r1", name) for name in ("front", "rear"))
COLOR, DEPTH = StreamKey(FRONT, Stream.COLOR), StreamKey(FRONT, Stream.DEPTH)
TOPIC, OTHER = "/front/color/image_raw", "/front/image_raw"


class Rig:
    def __init__(self, bus: Bus, camera: Node, offers: Offers) -> None:
        self.bus = bus
        self.camera = camera
        self.offers = offers

    async def offer(self, topics: Mapping[SensorKey, str], first: str | None = None) -> None:
        """Change to a plan."""
        await self.offers.change(Plan({key: Source(topic) for key, topic in topics.items()}, first=first))


@asynccontextmanager
async def rigged(returned: Returned = returned_in_root) -> AsyncIterator[Rig]:
    network = FakeNetwork()
    async with AsyncExitStack() as stack:
        theirs = await stack.enter_async_context(network.open_bus())
        ours = await stack.enter_async_context(network.open_bus())
        master = await stack.enter_async_context(RosMaster())
        camera = await stack.enter_async_context(Node("/camera", master_uri=master.uri))
        node = await stack.enter_async_context(Node("/gateway", master_uri=master.uri, poll_interval=0.2))
        async with asyncio.TaskGroup() as group:
            offers = new_offers(group, ours, node, returned)
            yield Rig(theirs, camera, offers)
            await offers.close()


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    async with rigged() as made:
        yield made


async def test_what_is_planned_is_present_and_what_is_not_no_longer_is(rig: Rig) -> None:
    async with rig.bus.watch("fleet/**/alive") as watch:
        await rig.offer({COLOR: TOPIC, DEPTH: "/depth"})
        assert {(await anext(watch)).key, (await anext(watch)).key} == {COLOR.alive, DEPTH.alive}
        await rig.offer({COLOR: TOPIC})
        gone = await anext(watch)
        assert (gone.key, gone.alive) == (DEPTH.alive, False)
        assert [status.stream for status in rig.offers.streams()] == ["color"]
        await rig.offers.change(NO_PLAN)
        assert rig.offers.streams() == []
        assert not (await anext(watch)).alive


async def frame_from(rig: Rig, topic: str) -> ImageFrame:
    """Subscribe to the stream as a detector does, publish garbage and an image on the topic, return what arrives."""
    async with (
        rig.camera.advertise(topic, TYPE_NAME) as publication,
        rig.bus.subscribe(str(COLOR), QUEUE(9)) as frames,
    ):
        await until(lambda: publication.subscriber_count, f"{topic} is subscribed")
        before = rig.offers.streams()[0].received
        publication.publish(b"garbage")
        await until(lambda: rig.offers.streams()[0].received > before, "the garbage has come")
        publication.publish(message(0))
        async with asyncio.timeout(60):
            sample = await anext(frames)
    return codec.decode(ImageFrame, sample.payload, sample.encoding)


async def test_a_stream_counts_on_when_it_has_another_topic_or_was_withdrawn(rig: Rig) -> None:
    await rig.offer({COLOR: TOPIC})
    assert (await frame_from(rig, TOPIC)).header.seq == 0
    await rig.offer({COLOR: OTHER})
    assert (await frame_from(rig, OTHER)).header.seq == 1
    (status,) = rig.offers.streams()
    assert (status.topic, status.received, status.forwarded, status.dropped) == (OTHER, 4, 2, {MALFORMED: 2})
    assert rig.offers.withdrawn() == {}
    broken = status.broken_links
    await rig.offers.change(NO_PLAN)
    assert rig.offers.withdrawn() == {MALFORMED: 2}
    await rig.offer({COLOR: TOPIC})
    assert rig.offers.withdrawn() == {}
    assert sum(rig.offers.streams()[0].broken_links.values()) >= sum(broken.values())
    assert (await frame_from(rig, TOPIC)).header.seq == 2


async def test_what_withdrawn_streams_dropped_is_added_up_without_those_that_are_back(rig: Rig) -> None:
    rear = StreamKey(REAR, Stream.COLOR)
    both: dict[SensorKey, str] = {COLOR: TOPIC, rear: "/rear"}
    await rig.offer(both)
    async with (
        rig.camera.advertise(TOPIC, TYPE_NAME) as front_publication,
        rig.camera.advertise("/rear", TYPE_NAME) as rear_publication,
        rig.bus.subscribe(str(COLOR), QUEUE(9)),
        rig.bus.subscribe(str(rear), QUEUE(9)),
    ):
        await until(lambda: [status.publishers for status in rig.offers.streams()] == [1, 1], "both are subscribed")
        front_publication.publish(b"garbage")
        rear_publication.publish(b"garbage")
        await until(lambda: all(status.dropped for status in rig.offers.streams()), "the garbage has come")
    for _ in range(2):
        await rig.offer({COLOR: TOPIC})
        assert rig.offers.withdrawn() == {MALFORMED: 1}
        await rig.offers.change(NO_PLAN)
        assert rig.offers.withdrawn() == {MALFORMED: 2}
        await rig.offer(both)
        assert rig.offers.withdrawn() == {}


async def test_results_follow_the_cameras_and_the_first_ones_topic_stays(rig: Rig) -> None:
    rear = StreamKey(REAR, Stream.COLOR)

    def topics() -> set[str]:
        return {returned.topic for returned in rig.offers.returns()}

    await rig.offer({COLOR: TOPIC, rear: "/rear"}, first="rear")
    assert {"/ultralytics/detection/classes", "/ultralytics/front/detection/classes"} <= topics()
    both = topics()
    await rig.offer({COLOR: TOPIC, DEPTH: "/depth"}, first="rear")
    assert "/ultralytics/detection/classes" not in topics()
    assert {returned.camera for returned in rig.offers.returns()} == {"front"}
    await rig.offer({COLOR: TOPIC, rear: "/rear"}, first="rear")
    assert topics() == both
    await rig.offers.change(NO_PLAN)
    assert rig.offers.returns() == []


async def test_withdrawing_ends_the_subscription(rig: Rig) -> None:
    await rig.offer({COLOR: TOPIC})
    async with (
        rig.camera.advertise(TOPIC, TYPE_NAME) as publication,
        rig.bus.subscribe(str(COLOR), QUEUE(9)),
    ):
        await until(lambda: publication.subscriber_count == 1, "it is subscribed")
        await rig.offers.change(NO_PLAN)
        await until(lambda: publication.subscriber_count == 0, "it is subscribed no longer")
        await rig.offer({COLOR: TOPIC})
        await until(lambda: publication.subscriber_count == 1, "it is subscribed again")


async def test_results_are_returned_for_no_more_cameras_than_a_status_lists(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    cameras = [CameraKey("r1", f"camera_{n:03}") for n in range(MAX_RETURNED + 2)]
    topics: dict[SensorKey, str] = {StreamKey(camera, Stream.COLOR): f"/{camera.camera}" for camera in cameras}
    await rig.offer(topics)
    assert len({returned.camera for returned in rig.offers.returns()}) == MAX_RETURNED
    assert f"results are returned for {MAX_RETURNED} cameras, not for 2 more" in caplog.text


async def test_results_whose_topic_is_in_use_are_refused_and_others_not(caplog: pytest.LogCaptureFixture) -> None:
    used = {"/ultralytics/rear/detection/classes": "/ultralytics/detection/classes"}
    async with rigged(lambda camera, root: camera_returns(camera, root, Names("/gateway", used).resolve)) as rig:
        rear = StreamKey(REAR, Stream.COLOR)
        await rig.offer({COLOR: TOPIC, rear: "/rear"}, first="front")
        async with (
            rig.camera.subscribe("/ultralytics/detection/classes", STRING, print),
            rig.camera.subscribe("/ultralytics/rear/detection/distance", STRING, print),
            rig.camera.subscribe("/ultralytics/detection/distance", STRING, print),
        ):
            wanted = {("front", "classes"), ("front", "distances"), ("rear", "distances")}
            await until(lambda: returned_to(rig) == wanted, "what is not refused is returned")
    assert "fleet/r1/rear/classes is not returned: /gateway publishes /ultralytics/detection/classes" in caplog.text


async def test_results_remapped_onto_a_sensors_topic_are_returned_only_while_no_sensor_is_there(
    caplog: pytest.LogCaptureFixture,
) -> None:
    overlay = {"/ultralytics/detection/image": "/rear/image_raw"}
    async with rigged(lambda camera, root: camera_returns(camera, root, Names("/gateway", overlay).resolve)) as rig:
        rear = StreamKey(REAR, Stream.COLOR)
        async with rig.camera.subscribe("/rear/image_raw", TYPE_NAME, print):
            await rig.offer({COLOR: TOPIC}, first="front")
            await until(lambda: returned_to(rig) == {("front", "overlay/detection")}, "no sensor is there yet")
            await rig.offer({COLOR: TOPIC, rear: "/rear/image_raw"}, first="front")
            assert returned_to(rig) == set()
            assert "/rear/image_raw" not in {returned.topic for returned in rig.offers.returns()}
            await rig.offer({COLOR: TOPIC}, first="front")
            await until(lambda: returned_to(rig) == {("front", "overlay/detection")}, "the sensor has gone")
    refused = "fleet/r1/front/overlay/detection is not returned: /rear/image_raw is a sensor's topic"
    assert caplog.messages.count(refused) == 1


def returned_to(rig: Rig) -> set[tuple[str, str]]:
    return {(status.camera, status.stream) for status in rig.offers.returns() if status.wanted}


async def test_points_and_the_picture_in_them_share_a_subscription(rig: Rig) -> None:
    points = StreamKey(FRONT, Stream.POINTS)
    await rig.offer({points: TOPIC, COLOR: TOPIC})
    async with (
        rig.camera.advertise(TOPIC, "sensor_msgs/PointCloud2") as publication,
        rig.bus.subscribe(str(COLOR), QUEUE(9)) as pictures,
        rig.bus.subscribe(str(points), QUEUE(9)) as clouds,
    ):
        await until(lambda: publication.subscriber_count == 1, "it is subscribed once")
        await until(lambda: all(status.publishers == 1 for status in rig.offers.streams()), "both are connected")
        publication.publish(bytes(colored().data))
        async with asyncio.timeout(60):
            picture, cloud = await anext(pictures), await anext(clouds)
        frame = codec.decode(ImageFrame, picture.payload, picture.encoding)
        about = codec.decode(PointCloud, cloud.payload, cloud.encoding).header
        assert (frame.header.stamp_ns, frame.header.frame_id) == (about.stamp_ns, about.frame_id)
        await rig.offer({points: OTHER, COLOR: TOPIC})
        await until(lambda: publication.subscriber_count == 1, "the colour is still subscribed")
        assert [(status.stream, status.dropped) for status in rig.offers.streams()] == [("color", {}), ("points", {})]
        publication.publish(bytes(colored().data))
        await until(lambda: rig.offers.streams()[0].broken_links, "points are no longer what colour may be of")


async def test_links_that_broke_before_a_stream_shared_the_subscription_are_not_its_own(rig: Rig) -> None:
    points, kind = StreamKey(FRONT, Stream.POINTS), "sensor_msgs/PointCloud2"

    def color_and_points() -> list[int]:
        return [sum(status.broken_links.values()) for status in rig.offers.streams()]

    await rig.offer({points: TOPIC, COLOR: TOPIC})
    async with rig.bus.subscribe(str(points), QUEUE(9)):
        async with rig.camera.advertise(TOPIC, kind) as publication:
            await until(lambda: publication.subscriber_count == 1, "it is subscribed")
        await until(lambda: color_and_points()[1], "the link has broken")
        await until(lambda: not rig.offers.streams()[1].problem, "the publisher is forgotten")
        for _ in range(2):
            async with rig.bus.subscribe(str(COLOR), QUEUE(9)):
                await until(lambda: rig.offers.streams()[0].wanted, "colour is wanted")
                await asyncio.sleep(0.05)
        assert color_and_points()[0] == 0
        async with rig.bus.subscribe(str(COLOR), QUEUE(9)), rig.camera.advertise(TOPIC, kind) as publication:
            await until(lambda: rig.offers.streams()[0].publishers, "colour is connected")
        await until(lambda: color_and_points()[0], "its link has broken")
        assert color_and_points()[1] > color_and_points()[0]


async def test_what_was_latched_before_is_kept_for_late_subscribers_of_the_other_stream_too(rig: Rig) -> None:
    points = StreamKey(FRONT, Stream.POINTS)
    await rig.offer({points: TOPIC, COLOR: TOPIC})
    async with (
        rig.camera.advertise(TOPIC, "sensor_msgs/PointCloud2", latch=True) as publication,
        rig.bus.subscribe(str(points), QUEUE(9)) as clouds,
        asyncio.timeout(60),
    ):
        publication.publish(bytes(colored().data))
        await anext(clouds)
        async with rig.bus.subscribe(str(COLOR), QUEUE(9)) as pictures:
            await anext(pictures)
            async with rig.bus.subscribe(str(COLOR), QUEUE(9)) as late:
                await anext(late)
