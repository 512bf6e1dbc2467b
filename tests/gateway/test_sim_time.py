import asyncio
import struct
from contextlib import AsyncExitStack

import pytest

from gateway.process import follow_sim_time
from gateway.ros1.node import Node
from gateway.ros1.sim_clock import PARAMETER, TOPIC, TYPE_NAME, SimClock
from services.simulator.ros_master.master import RosMaster
from services.toolbox.logs import RateLimit, RateLimitFilter
from tests.waiting import until

POLL_S = 0.05


async def test_the_clock_is_followed_while_the_parameter_says_so(caplog: pytest.LogCaptureFixture) -> None:
    clock = SimClock()
    async with (
        RosMaster() as master,
        Node("/player", master_uri=master.uri) as player,
        Node("/gateway", master_uri=master.uri, poll_interval=0.1) as node,
        player.advertise(TOPIC, TYPE_NAME) as publication,
    ):
        following = asyncio.create_task(follow_sim_time(node, clock, poll_s=POLL_S))
        await asyncio.sleep(3 * POLL_S)
        assert (publication.subscriber_count, clock.ros_time_ns) == (0, None)
        await player.master.call("setParam", PARAMETER, True)  # noqa: FBT003 - its value
        await until(lambda: publication.subscriber_count, "the clock is subscribed to")
        assert clock.ros_time_ns == 0
        for second in (5, 6, 2):
            publication.publish(struct.pack("<II", second, 1))
            await until(lambda: clock.now_ns == second * 1_000_000_000 + 1, "the clock is told")  # noqa: B023
        publication.publish(b"garbage")
        await until(lambda: "7 bytes are not a rosgraph_msgs/Clock" in caplog.text, "garbage is told of")
        assert (clock.ros_time_ns, clock.jumps) == (2_000_000_001, 1)
        await player.master.call("setParam", PARAMETER, False)  # noqa: FBT003
        await until(lambda: not publication.subscriber_count, "the clock is no longer subscribed to")
        assert clock.ros_time_ns is None
        following.cancel()
        await asyncio.wait([following])


async def test_two_that_tell_different_times_do_not_fill_the_log(caplog: pytest.LogCaptureFixture) -> None:
    clock = SimClock()
    async with (
        RosMaster() as master,
        Node("/player", master_uri=master.uri) as player,
        Node("/gateway", master_uri=master.uri, poll_interval=0.1) as node,
        player.advertise(TOPIC, TYPE_NAME, queue_size=40) as publication,
    ):
        await player.master.call("setParam", PARAMETER, True)  # noqa: FBT003 - its value
        following = asyncio.create_task(follow_sim_time(node, clock, poll_s=POLL_S))
        await until(lambda: publication.subscriber_count, "the clock is subscribed to")
        with caplog.filtering(RateLimitFilter(RateLimit())):
            for second in [50, 1] * 20:
                publication.publish(struct.pack("<II", second, 0))
            await until(lambda: clock.jumps == 20, "all of it is told")
        assert caplog.text.count("went back") == 1
        following.cancel()
        await asyncio.wait([following])


async def test_a_master_that_goes_away_has_not_changed_its_mind() -> None:
    clock = SimClock()
    async with AsyncExitStack() as stack:
        async with RosMaster() as master:
            node = await stack.enter_async_context(Node("/gateway", master_uri=master.uri, poll_interval=0.1))
            await node.master.call("setParam", PARAMETER, True)  # noqa: FBT003
            following = asyncio.create_task(follow_sim_time(node, clock, poll_s=POLL_S))
            await until(lambda: clock.used, "it is used")
        await until(lambda: node.master_answers is False, "the master has gone")
        await asyncio.sleep(3 * POLL_S)
        assert clock.used
        following.cancel()
        await asyncio.wait([following])
