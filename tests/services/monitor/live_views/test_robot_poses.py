"""Poses of robots that a page watches."""

import asyncio

from bus import QoS
from bus.clocks import clock_id
from bus.fake import FakeNetwork
from schemas import codec, consumer_keys
from schemas.keys import RobotStreamKey
from schemas.transforms import Transforms
from services.monitor.live_views.robot_poses import HeldRobots, Robots, robots
from services.monitor.live_views.shared import SharedSubscriptions
from services.monitor.map.pose import Pose, Whereabouts
from tests.services.monitor.map.test_pose import message, transform
from tests.waiting import until

ENCODING = codec.encoding(Transforms)


async def test_transforms_are_wanted_while_somebody_looks_at_the_map() -> None:
    network = FakeNetwork()
    async with (
        network.open_bus("central") as ours,
        network.open_bus() as theirs,
        theirs.publisher(str(RobotStreamKey("r1", "tf")), QoS.STATUS, encoding=ENCODING) as moving,
        theirs.publisher(str(RobotStreamKey("r1", "tf_static")), QoS.LATCHED, encoding=ENCODING) as still,
        theirs.watch(consumer_keys.every_wanted("r1")) as tokens,
    ):
        still.put(codec.encode(message(transform("map", "odom", 0))))
        assert not moving.wanted
        async with robots(ours).hold("r1") as where:
            await until(lambda: moving.wanted)
            moving.put(b"nothing")
            moving.put(codec.encode(message(transform("odom", "base_link", 5, 2.0))))
            await until(lambda: isinstance(where.pose(), Pose))
            pose = where.pose()
            assert isinstance(pose, Pose)
            assert (pose.x, pose.y) == (2.0, 2.0)
            wanted = consumer_keys.parse_wanted((await anext(tokens)).key)
            assert (wanted.key, wanted.clock_id) == (RobotStreamKey("r1", "tf"), clock_id())
            assert wanted.consumer.startswith("central-")
        await until(lambda: not moving.wanted)


async def test_a_map_follows_as_many_robots_as_there_is_room_for() -> None:
    async def idle(_: str, __: Whereabouts) -> None:
        await asyncio.Event().wait()

    shared: Robots = SharedSubscriptions(lambda _: Whereabouts(), idle, most=2)
    async with HeldRobots(shared) as held:
        assert list(await held.keep(["r1", "r2"])) == ["r1", "r2"]
        assert list(await held.keep(["r2", "r3", "r4"])) == ["r2", "r3"]
        assert held.crowded
        assert list(await held.keep(["r3"])) == shared.keys == ["r3"]
        assert not held.crowded
    assert shared.keys == []
