"""A gateway's returned streams between a fake bus and an embedded ROS master."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field

import pytest

from bus import Publisher, QoS
from bus.fake import FakeNetwork
from gateway.outgoing.returning import Return
from gateway.outgoing.stream import DOUBLED, MALFORMED, StreamReturn
from gateway.outgoing.translators import CLASSES, STRING
from gateway.ros1.messages import deserialise
from gateway.ros1.node import Node
from gateway.ros1.rosmaster import RosMaster
from gateway.ros1.subscriber import Message
from schemas import codec
from schemas.detections import ClassList
from schemas.keys import CameraKey, Stream
from tests.gateway.outgoing.lists import class_list
from tests.gateway.ros1.cancelling import cancel_everywhere, open_sockets
from tests.gateway.ros1.waiting import until

FRONT = CameraKey("r1", "front")
KEY = FRONT.stream(Stream.CLASSES)
TOPIC = "/ultralytics/detection/classes"


@dataclass
class Rig:
    """detector: publishes under the stream's key. robot: a node of the robot's own."""

    detector: Publisher
    robot: Node
    returned: Return[ClassList]
    heard: list[str] = field(default_factory=list)

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[None]:
        """Listen on ROS, and return once the detector knows."""
        async with self.robot.subscribe(TOPIC, STRING, self._hear):
            await until(lambda: self.detector.wanted, "the detector is wanted")
            yield

    def _hear(self, message: Message) -> None:
        self.heard.append(deserialise(STRING, message.data).data)

    def publish(self, seen: ClassList) -> None:
        self.detector.put(codec.encode(seen))

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
        node = await stack.enter_async_context(Node("/gateway", master_uri=master.uri, poll_interval=0.2))
        returned = Return(StreamReturn(FRONT, "/ultralytics", CLASSES))
        encoding = codec.encoding(ClassList)
        detector = await stack.enter_async_context(theirs.publisher(KEY, QoS.RESULT, encoding=encoding))
        running = asyncio.create_task(returned.run(node, ours))
        await until(lambda: returned.publication, "it is advertised")
        await until(lambda: node.registered, "the gateway is registered")
        yield Rig(detector, robot, returned)
        running.cancel()
        await asyncio.wait([running])


async def test_nobody_listening_on_ros_is_no_demand(rig: Rig) -> None:
    await asyncio.sleep(0.3)
    assert not rig.detector.wanted
    status = rig.returned.status()
    assert (status.topic, status.wanted, status.subscribers) == (TOPIC, False, 0)


async def test_results_reach_a_ros_subscriber_and_its_end_ends_the_demand(rig: Rig) -> None:
    async with rig.listening():
        rig.publish(class_list(("box", 2), ("pallet", 1)))
        await rig.until_heard("['box', 'box', 'pallet']")
        assert (rig.returned.status().wanted, rig.returned.status().subscribers) == (True, 1)
    await until(lambda: not rig.detector.wanted, "the demand has ended")
    status = rig.returned.status()
    assert (status.wanted, status.subscribers, status.received, status.published) == (False, 0, 1, 1)


async def test_a_result_of_before_is_not_passed_for_one_of_now(rig: Rig) -> None:
    rig.publish(class_list(("forklift", 1), seq=0))
    for seq, name in ((1, "box"), (2, "pallet")):
        async with rig.listening():
            rig.publish(class_list((name, 1), seq=seq))
            await until(lambda: rig.heard, "it is heard")
        await until(lambda: not rig.detector.wanted, "the demand has ended")
        assert rig.heard == [f"['{name}']"]
        rig.heard.clear()


async def test_a_frame_is_returned_once_even_to_one_who_comes_again(rig: Rig) -> None:
    async with rig.listening():
        rig.publish(class_list(("box", 1), seq=7))
        await rig.until_heard("['box']")
    await until(lambda: not rig.detector.wanted, "the demand has ended")
    async with rig.listening():
        rig.publish(class_list(("box", 1), seq=7))
        await until(lambda: rig.returned.status().dropped, "the double is counted")
        rig.publish(class_list(("pallet", 1), seq=8))
        await rig.until_heard("['box']", "['pallet']")
    assert rig.returned.status().dropped == {DOUBLED: 1}


async def test_malformed_results_are_counted_and_harm_nothing(rig: Rig, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        async with rig.listening():
            for payload in (b"garbage", codec.encode(class_list(camera="rear"))):
                counted = rig.returned.status().received + 1
                rig.detector.put(payload)
                await until(lambda: rig.returned.status().received == counted, "it is counted")  # noqa: B023
            rig.publish(class_list(("box", 1)))
            await rig.until_heard("['box']")
    assert rig.returned.status().dropped == {MALFORMED: 2}
    assert f"{KEY}: result left out" in caplog.text


async def test_cancelled_at_any_await_nothing_is_left() -> None:
    network = FakeNetwork()
    async with (
        RosMaster() as master,
        Node("/planner", master_uri=master.uri) as robot,
        network.open_bus() as theirs,
        network.open_bus() as ours,
        theirs.publisher(KEY, QoS.RESULT) as detector,
    ):
        await robot.master.get_pid()
        tasks, sockets = asyncio.all_tasks(), open_sockets()

        async def life() -> None:
            async with (
                Node("/gateway", master_uri=master.uri) as node,
                node.subscribe(TOPIC, STRING, print),
                asyncio.TaskGroup() as group,
            ):
                returned = Return(StreamReturn(FRONT, "/ultralytics", CLASSES))
                running = group.create_task(returned.run(node, ours))
                while not detector.wanted:  # noqa: ASYNC110 - each turn of the loop is a suspension
                    await asyncio.sleep(0)
                running.cancel()

        async def nothing_is_left(n: int) -> None:
            state = await robot.master.get_system_state()
            assert (state.publishers, state.subscribers) == ({}, {}), n
            await until(lambda: not detector.wanted, f"no subscription is left after {n}")
            await until(lambda: asyncio.all_tasks() <= tasks, f"no task is left after {n}")
            await until(lambda: open_sockets() <= sockets, f"no socket is left after {n}")

        assert await cancel_everywhere(life, nothing_is_left) > 20
