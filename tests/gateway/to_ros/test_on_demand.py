"""A gateway's returned streams between a fake bus and an embedded ROS master."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec
import pytest

from bus import Bus, Publisher, QoS
from bus.fake import FakeNetwork
from gateway.ros1 import image as ros_image
from gateway.ros1.image import decode_image
from gateway.ros1.messages import deserialise
from gateway.ros1.node import Node
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_ros.on_demand import Return
from gateway.to_ros.outputs import STRING, actions_return, alerts_return, camera_returns
from gateway.to_ros.stream import DOUBLED, MALFORMED, REFUSED, SLOW, UNHEARD, StreamReturn
from schemas import codec
from schemas.detections import ClassList
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.cancelling import cancel_everywhere, nothing_registered
from tests.gateway.to_ros.lists import class_list
from tests.gateway.to_ros.namespaces import IN_ROOT
from tests.gateway.to_ros.overlays import overlay
from tests.schemas.results import action, alert
from tests.waiting import until

FRONT = CameraKey("r1", "front")
KEY = FRONT.stream(Stream.CLASSES)
TOPIC = "/ultralytics/detection/classes"
RECORDER = "/recorder"
PICK_UP, STOP = "/planner/pick_up", "/planner/stop"


def returned_of(stream: Stream) -> StreamReturn[Any]:
    return next(made for made in camera_returns(FRONT, "/ultralytics", IN_ROOT) if made.key.stream == stream)


@dataclass
class Rig:
    """theirs: a fleet's place on the bus, ours: the gateway's. robot: a ROS node of the robot's own."""

    theirs: Bus
    ours: Bus
    robot: Node
    node: Node
    heard: list[str] = field(default_factory=list)

    @asynccontextmanager
    async def returning(self, stream: StreamReturn[Any]) -> AsyncIterator[Return[Any]]:
        """Return a stream, as the gateway does."""
        returned = Return(stream)
        running = asyncio.create_task(returned.run(self.node, self.ours))
        topics = set(stream.topics.values())
        await until(lambda: set(returned.publications) == topics and self.node.registered, "it is advertised")
        yield returned
        running.cancel()
        await asyncio.wait([running])

    @asynccontextmanager
    async def publishing(
        self, key: str, schema: type[codec.Message], qos: QoS = QoS.RESULT
    ) -> AsyncIterator[Publisher]:
        async with self.theirs.publisher(key, qos, encoding=codec.encoding(schema)) as publisher:
            yield publisher

    @asynccontextmanager
    async def listening(self, topic: str = TOPIC) -> AsyncIterator[None]:
        """Listen to texts on ROS."""
        async with self.robot.subscribe(topic, STRING, self._hear):
            yield

    def _hear(self, message: Message) -> None:
        self.heard.append(deserialise(STRING, message.data).data)

    async def until_heard(self, *texts: str) -> None:
        await until(lambda: self.heard == list(texts), f"{texts} is heard")


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    network = FakeNetwork()
    async with AsyncExitStack() as stack:
        theirs = await stack.enter_async_context(network.open_bus())
        ours = await stack.enter_async_context(network.open_bus())
        master = await stack.enter_async_context(RosMaster())
        robot = await stack.enter_async_context(Node("/planner", master_uri=master.uri, poll_interval=0.2))
        node = Node("/gateway", master_uri=master.uri, poll_interval=0.2, passive=lambda name: name == RECORDER)
        await stack.enter_async_context(node)
        yield Rig(theirs, ours, robot, node)


@dataclass
class Classes:
    """The stream of class lists. detector: publishes under its key."""

    rig: Rig
    detector: Publisher
    returned: Return[ClassList]

    @asynccontextmanager
    async def heard(self) -> AsyncIterator[list[str]]:
        """Listen on ROS, and return once the detector knows."""
        async with self.rig.listening():
            await until(lambda: self.detector.wanted, "the detector is wanted")
            yield self.rig.heard

    def publish(self, seen: ClassList) -> None:
        self.detector.put(codec.encode(seen))

    async def until_unwanted(self) -> None:
        await until(lambda: not self.detector.wanted, "the demand has ended")


@pytest.fixture
async def classes(rig: Rig) -> AsyncIterator[Classes]:
    async with rig.returning(returned_of(Stream.CLASSES)) as returned, rig.publishing(KEY, ClassList) as detector:
        yield Classes(rig, detector, returned)


async def test_nobody_listening_on_ros_is_no_demand(classes: Classes) -> None:
    await asyncio.sleep(0.3)
    assert not classes.detector.wanted
    status = classes.returned.status()
    assert (status.topic, status.wanted, status.subscribers) == (TOPIC, False, 0)


async def test_results_reach_a_ros_subscriber_and_its_end_ends_the_demand(classes: Classes) -> None:
    async with classes.heard():
        classes.publish(class_list(("box", 2), ("pallet", 1)))
        await classes.rig.until_heard("['box', 'box', 'pallet']")
        assert (classes.returned.status().wanted, classes.returned.status().subscribers) == (True, 1)
    await classes.until_unwanted()
    status = classes.returned.status()
    assert (status.wanted, status.subscribers, status.received, status.published) == (False, 0, 1, 1)


async def test_a_result_of_before_is_not_passed_for_one_of_now(classes: Classes) -> None:
    classes.publish(class_list(("forklift", 1), seq=0))
    for seq, name in ((1, "box"), (2, "pallet")):
        async with classes.heard() as heard:
            classes.publish(class_list((name, 1), seq=seq))
            await until(lambda: classes.rig.heard, "it is heard")
        await classes.until_unwanted()
        assert heard == [f"['{name}']"]
        heard.clear()


async def test_a_frame_is_returned_once_even_to_one_who_comes_again(classes: Classes) -> None:
    async with classes.heard():
        classes.publish(class_list(("box", 1), seq=7))
        await classes.rig.until_heard("['box']")
    await classes.until_unwanted()
    async with classes.heard():
        classes.publish(class_list(("box", 1), seq=7))
        await until(lambda: classes.returned.status().dropped, "the double is counted")
        classes.publish(class_list(("pallet", 1), seq=8))
        await classes.rig.until_heard("['box']", "['pallet']")
    assert classes.returned.status().dropped == {DOUBLED: 1}


async def test_what_slow_subscribers_missed_counts_on_when_the_camera_comes_back(rig: Rig) -> None:
    stream = returned_of(Stream.CLASSES)
    for total in (2, 4):
        async with rig.returning(stream) as returned, rig.listening():
            publication = returned.publications[TOPIC]
            await until(lambda publication=publication: publication.subscriber_count, "it is subscribed")  # type: ignore[misc]
            for _ in range(stream.translator.waiting + 2):
                publication.publish(b"")
            assert returned.status().dropped == {SLOW: total}
        assert returned.status().dropped == {SLOW: total}


async def test_malformed_results_are_counted_and_harm_nothing(
    classes: Classes, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        async with classes.heard():
            for payload in (b"garbage", codec.encode(class_list(camera="rear"))):
                counted = classes.returned.status().received + 1
                classes.detector.put(payload)
                await until(lambda: classes.returned.status().received == counted, "it is counted")  # noqa: B023
            classes.publish(class_list(("box", 1)))
            await classes.rig.until_heard("['box']")
    assert classes.returned.status().dropped == {MALFORMED: 2}
    assert f"{KEY}: result left out" in caplog.text


async def test_overlays_are_decoded_and_a_damaged_one_costs_itself_only(rig: Rig) -> None:
    stream, images = returned_of(Stream.OVERLAY_DETECTION), list[ros_image.Image]()
    async with (
        rig.returning(stream) as returned,
        rig.publishing(str(stream.key), ImageFrame, QoS.IMAGE) as detector,
        rig.robot.subscribe(
            "/ultralytics/detection/image",
            ros_image.TYPE_NAME,
            lambda message: images.append(decode_image(bytes(message.data))),
        ),
    ):
        await until(lambda: detector.wanted, "the overlay is wanted")
        for seq, cut in ((1, 0), (2, 100), (3, 0)):
            counted = returned.status().published + sum(returned.status().dropped.values()) + 1
            frame = overlay(seq=seq)
            whole = frame.data.nbytes
            detector.put(codec.encode(msgspec.structs.replace(frame, data=frame.data[: whole - cut])))
            await until(
                lambda: returned.status().published + sum(returned.status().dropped.values()) == counted,  # noqa: B023
                "it is counted",
            )
        await until(lambda: len(images) == 2, "both good ones are there")
    assert [(image.seq, image.stamp_ns, image.encoding, image.data.nbytes) for image in images] == [
        (1, 1, "rgb8", 48 * 64 * 3),
        (2, 3, "rgb8", 48 * 64 * 3),
    ]
    assert returned.status().dropped == {MALFORMED: 1}


async def test_alerts_are_wanted_while_heard_and_latched_for_who_comes_late(rig: Rig) -> None:
    stream = alerts_return("r1", IN_ROOT)
    async with rig.returning(stream) as returned, rig.publishing(str(stream.key), type(alert())) as monitor:
        monitor.put(codec.encode(alert(text="before anybody listened")))
        assert not monitor.wanted
        async with rig.listening("/ultralytics/alerts"):
            await until(lambda: len(rig.heard) == 1, "the last alert comes from the fleet's own history")
            for n in range(10):
                monitor.put(codec.encode(alert(id_=f"b{n}", text="now")))
            await until(lambda: len(rig.heard) == 11, "no alert replaces another")
        await until(lambda: not monitor.wanted, "the demand has ended")
        async with rig.listening("/ultralytics/alerts"):
            await until(lambda: len(rig.heard) == 12, "the last one is latched")
            await until(lambda: returned.status().dropped, "and not taken from the fleet again")
    assert rig.heard[0].startswith('{"id":"a1",')
    assert rig.heard[11] == rig.heard[10]
    assert (returned.status().published, returned.status().dropped) == (11, {DOUBLED: 1})


async def test_actions_go_to_their_own_topics_and_others_are_refused(rig: Rig) -> None:
    stream = actions_return("r1", {"pick_up": PICK_UP, "stop": STOP}, IN_ROOT)
    async with rig.returning(stream) as returned, rig.publishing(str(stream.key), type(action())) as monitor:
        await until(lambda: monitor.wanted, "the gateway listens without being asked")
        for sent, dropped in (
            (action(id_="1", name="dance"), {REFUSED: 1}),
            (action(id_="2"), {REFUSED: 1, UNHEARD: 1}),
        ):
            monitor.put(codec.encode(sent))
            await until(lambda: returned.status().dropped == dropped, "it is counted")  # noqa: B023
        async with rig.listening(PICK_UP):
            await until(lambda: returned.status().subscribers == 1, "the planner is connected")
            for n in range(3, 8):
                monitor.put(codec.encode(action(id_=str(n), payload=f"box {n}")))
                monitor.put(codec.encode(action(id_=f"-{n}", name="stop")))
            await rig.until_heard(*(f"box {n}" for n in range(3, 8)))
        assert monitor.wanted
    assert returned.status().published == 5
    assert returned.status().dropped == {REFUSED: 1, UNHEARD: 6}


async def test_an_action_of_before_is_not_done_now(rig: Rig) -> None:
    stream = actions_return("r1", {"pick_up": PICK_UP}, IN_ROOT)
    async with rig.publishing(str(stream.key), type(action())) as monitor:
        monitor.put(codec.encode(action(payload="long ago")))
        async with rig.returning(stream) as returned, rig.listening(PICK_UP):
            await until(lambda: returned.status().subscribers == 1, "the planner is connected")
            monitor.put(codec.encode(action(id_="2", payload="now")))
            await rig.until_heard("now")
        assert returned.status().received == 1


async def test_cancelled_at_any_await_nothing_is_left() -> None:
    network = FakeNetwork()
    stream = returned_of(Stream.OVERLAY_DETECTION)
    async with (
        RosMaster() as master,
        Node("/planner", master_uri=master.uri) as robot,
        network.open_bus() as theirs,
        network.open_bus() as ours,
        theirs.publisher(str(stream.key), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as detector,
    ):
        await robot.master.get_pid()
        await asyncio.to_thread(int)  # the pool's first thread has a socket of its own

        async def life() -> None:
            async with (
                Node("/gateway", master_uri=master.uri) as node,
                node.subscribe("/ultralytics/detection/image", ros_image.TYPE_NAME, lambda _: None),
                asyncio.TaskGroup() as group,
            ):
                returned = Return(returned_of(Stream.OVERLAY_DETECTION))
                running = group.create_task(returned.run(node, ours))
                while not detector.wanted:  # noqa: ASYNC110 - each turn of the loop is a suspension
                    await asyncio.sleep(0)
                detector.put(codec.encode(overlay()))
                while not returned.status().published:  # noqa: ASYNC110
                    await asyncio.sleep(0.001)
                running.cancel()

        async def nothing_is_left(n: int) -> None:
            await nothing_registered(robot, n)
            await until(lambda: not detector.wanted, f"no subscription is left after {n}")

        assert await cancel_everywhere(life, nothing_is_left, sockets=True) > 20


@asynccontextmanager
async def recording(rig: Rig, topic: str) -> AsyncIterator[list[Message]]:
    """Listen as a node that the gateway takes for passive."""
    heard: list[Message] = []
    async with (
        Node(RECORDER, master_uri=rig.node.master_uri, poll_interval=0.2) as node,
        node.subscribe(topic, STRING, heard.append),
    ):
        yield heard


async def test_for_a_recorder_alone_no_result_is_made(classes: Classes) -> None:
    async with recording(classes.rig, TOPIC) as recorded:
        await until(lambda: classes.returned.status().subscribers == 1, "the recorder is connected")
        assert not classes.returned.status().wanted
        assert not classes.detector.wanted
        async with classes.heard():
            classes.publish(class_list(("box", 1)))
            await until(lambda: len(recorded) == 1, "what another one wants is recorded")
        await classes.until_unwanted()


async def test_an_action_that_only_a_recorder_would_hear_is_unheard(rig: Rig) -> None:
    stream = actions_return("r1", {"pick_up": PICK_UP}, IN_ROOT)
    async with rig.returning(stream) as returned, rig.publishing(str(stream.key), type(action())) as monitor:
        await until(lambda: monitor.wanted, "the gateway listens without being asked")
        async with recording(rig, PICK_UP):
            await until(lambda: returned.status().subscribers == 1, "the recorder is connected")
            monitor.put(codec.encode(action(id_="1")))
            await until(lambda: returned.status().dropped == {UNHEARD: 1}, "it is counted")
