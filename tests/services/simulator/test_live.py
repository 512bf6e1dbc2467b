import asyncio
import time
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

import pytest

from gateway.ros1.image import TYPE_NAME, decode_image
from gateway.ros1.messages import deserialise
from gateway.ros1.node import Node
from gateway.ros1.tcpros.subscriber import Message
from services.simulator.film import Film, Part, Store
from services.simulator.process import LiveRobot
from services.simulator.robot import Robot
from services.simulator.ros_master.master import RosMaster
from services.simulator.topics import Content, SimulatedStream, topics
from services.simulator.world import ChangingWorld, generate
from tests.services.simulator.small import ALIGNED, FRAMES, HZ, PLENTY
from tests.waiting import until

COLOR_TOPIC = "/camera/color/image_raw"


@pytest.fixture
def robot() -> Robot:
    return Robot("r1", "", Film(1, ALIGNED, FRAMES, HZ, Store(PLENTY)), topics(list(SimulatedStream), aligned=True))


@asynccontextmanager
async def driving(live: LiveRobot) -> AsyncIterator[Node]:
    """Let the robot drive; yield a node at its master."""
    with ThreadPoolExecutor(1) as executor:
        async with (
            RosMaster() as master,
            Node("/robot", master_uri=master.uri) as theirs,
            Node("/us", master_uri=master.uri) as ours,
        ):
            task = asyncio.create_task(live.run(theirs, executor))
            try:
                yield ours
            finally:
                task.cancel()
                await asyncio.wait([task])


async def test_colour_is_sent_while_somebody_subscribes_and_nothing_else_is_measured(robot: Robot) -> None:
    received: asyncio.Queue[Message] = asyncio.Queue()
    live = LiveRobot(robot, hz=50)
    assert live.sent == 0
    async with driving(live) as ours:
        await asyncio.sleep(0.1)
        assert robot.film.store.size == 0
        before_ns = time.time_ns()
        async with asyncio.timeout(60), ours.subscribe(COLOR_TOPIC, TYPE_NAME, received.put_nowait):
            images = [decode_image((await received.get()).data) for _ in range(3)]
        assert live.sent >= 3
    assert all((image.height, image.width, image.step, image.encoding) == (48, 64, 192, "rgb8") for image in images)
    assert all(before_ns < image.stamp <= time.time_ns() for image in images)
    for image in images:
        assert bytes(image.data) == robot.film.measure(image.seq, {Part.COLOR})[Part.COLOR].tobytes()
    assert all(robot.film.store.get((1, number, Part.DEPTH)) is None for number in range(FRAMES))


async def test_a_changing_world_is_seen_as_it_is_since_the_fleet_began() -> None:
    world = ChangingWorld(generate(1), 20.0)
    film = Film(1, ALIGNED, FRAMES, HZ, Store(PLENTY), world=world)
    robot = Robot("r1", "", film, topics([SimulatedStream.COLOR], aligned=True))
    begun_s = asyncio.get_running_loop().time() - 200.0
    received: asyncio.Queue[Message] = asyncio.Queue()
    async with (
        driving(LiveRobot(robot, hz=5, begun_s=begun_s)) as ours,
        asyncio.timeout(60),
        ours.subscribe(COLOR_TOPIC, TYPE_NAME, received.put_nowait),
    ):
        images = [decode_image((await received.get()).data) for _ in range(3)]
    assert images[0].seq >= 1_000
    for image in images:
        expected = film.measure(image.seq, {Part.COLOR}, image.seq / 5)
        assert bytes(image.data) == expected[Part.COLOR].tobytes()


async def test_every_topic_of_an_instant_arrives_with_one_stamp(robot: Robot) -> None:
    by_stamp: dict[tuple[int, int], set[Content]] = {}
    static: list[Any] = []

    def receive(content: Content, kind: str, message: Message) -> None:
        found = deserialise(kind, message.data)
        if content is Content.TF_STATIC:
            static.append(found)
            return
        header = found.transforms[0].header if content is Content.TF else found.header
        by_stamp.setdefault((header.stamp.sec, header.stamp.nanosec), set()).add(content)

    everything = set(Content) - {Content.TF_STATIC}
    async with driving(LiveRobot(robot, hz=20, delay_s=0.01)) as ours:
        subscriptions = [
            ours.subscribe(robot.path(topic), topic.type, partial(receive, topic.content, topic.type))
            for topic in robot.topics
        ]
        async with asyncio.TaskGroup() as group:
            stop = asyncio.Event()
            for subscription in subscriptions:
                group.create_task(_hold(subscription, stop))
            try:
                await until(lambda: static and everything in by_stamp.values(), "an instant is whole")
            finally:
                stop.set()
    assert static[0].transforms[0].child_frame_id == "camera_link"


async def _hold(subscription: Any, stop: asyncio.Event) -> None:
    async with subscription:
        await stop.wait()
