"""Several readers of one topic, between an embedded ROS master and a publisher."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from gateway.ros1.node import Node
from gateway.ros1.tcpros.publisher import Publication
from gateway.ros1.tcpros.subscriber import Message, Subscription
from gateway.to_bus import subscriptions
from gateway.to_bus.subscriptions import Subscriptions
from services.simulator.ros_master.master import RosMaster
from tests.waiting import until

STRING = "std_msgs/String"
WORD = b"\x02\x00\x00\x00hi"
LONGER = b"\x05\x00\x00\x00hello"


class Reader:
    def __init__(self, topics: Subscriptions) -> None:
        self._topics = topics
        self.heard: list[bytes] = []
        self.gone: list[str] = []
        self.unkept: list[int] = []

    @asynccontextmanager
    async def reading(self) -> AsyncIterator[Subscription]:
        async with self._topics.subscribe(
            "/word", STRING, self._take, on_gone=self.gone.append, on_unkept=self.unkept.append
        ) as subscription:
            yield subscription

    def _take(self, message: Message) -> None:
        self.heard.append(bytes(message.data))


class Rig:
    def __init__(self, sensor: Node, topics: Subscriptions) -> None:
        self.sensor = sensor
        self.one, self.other = Reader(topics), Reader(topics)


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    async with AsyncExitStack() as stack:
        master = await stack.enter_async_context(RosMaster())
        sensor = await stack.enter_async_context(Node("/sensor", master_uri=master.uri))
        node = await stack.enter_async_context(Node("/gateway", master_uri=master.uri, poll_interval=0.2))
        yield Rig(sensor, Subscriptions(node))


async def subscribed(publication: Publication, count: int) -> None:
    await until(lambda: publication.subscriber_count == count, f"{count} subscribe")


async def test_two_readers_share_one_subscription_until_both_have_left(rig: Rig) -> None:
    async with rig.sensor.advertise("/word", STRING) as publication, rig.one.reading() as first:
        async with AsyncExitStack() as leaving:
            assert await leaving.enter_async_context(rig.other.reading()) is first
            await subscribed(publication, 1)
            publication.publish(WORD)
            await until(lambda: rig.one.heard == rig.other.heard == [WORD], "both hear it")
        publication.publish(WORD)
        await until(lambda: rig.one.heard == [WORD, WORD], "who stays hears on")
        assert rig.other.heard == [WORD]


async def test_whoever_came_first_may_leave_first(rig: Rig) -> None:
    async with rig.sensor.advertise("/word", STRING) as publication:
        async with AsyncExitStack() as staying:
            async with rig.one.reading():
                await staying.enter_async_context(rig.other.reading())
            await subscribed(publication, 1)
            publication.publish(WORD)
            await until(lambda: rig.other.heard == [WORD], "the other one hears it")
        await subscribed(publication, 0)
        async with rig.one.reading():
            await subscribed(publication, 1)


async def test_who_comes_later_is_told_what_was_latched_and_both_that_it_has_gone(rig: Rig) -> None:
    async with AsyncExitStack() as readers:
        async with rig.sensor.advertise("/word", STRING, latch=True) as publication:
            publication.publish(WORD)
            await readers.enter_async_context(rig.one.reading())
            await until(lambda: rig.one.heard == [WORD], "the first one hears it")
            await readers.enter_async_context(rig.other.reading())
            assert rig.other.heard == [WORD]
        await until(lambda: len(rig.one.gone) == len(rig.other.gone) == 1, "both are told")


async def test_what_latching_publishers_sent_is_kept_for_later_readers_only_as_far_as_there_is_room(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subscriptions, "MAX_BYTES", len(WORD))
    async with rig.sensor.advertise("/word", STRING, latch=True) as publication, rig.one.reading():
        publication.publish(WORD)
        await until(lambda: rig.one.heard == [WORD], "it is heard")
        async with rig.other.reading():
            assert (rig.other.heard, rig.other.unkept) == ([WORD], [])
        publication.publish(LONGER)
        await until(lambda: rig.one.heard == [WORD, LONGER], "the longer one is heard too")
        async with rig.other.reading():
            assert (rig.other.heard, rig.other.unkept) == ([WORD], [len(LONGER)])
        publication.publish(WORD)
        await until(lambda: rig.one.heard[2:] == [WORD], "there is room again")
        async with rig.other.reading():
            assert (rig.other.heard, rig.other.unkept) == ([WORD, WORD], [len(LONGER)])


async def test_readers_that_come_and_go_at_the_same_instant_never_meet_a_subscription_that_ends(rig: Rig) -> None:
    async with rig.sensor.advertise("/word", STRING) as publication:
        for _ in range(3):
            async with AsyncExitStack() as first, AsyncExitStack() as second:
                one, other = await asyncio.gather(
                    first.enter_async_context(rig.one.reading()), second.enter_async_context(rig.other.reading())
                )
                assert one is other
                await subscribed(publication, 1)
                await first.aclose()
                leaving = asyncio.create_task(second.aclose())
                await asyncio.sleep(0)
                async with rig.other.reading() as again:
                    assert again is not other
                    leaving.cancel()
                    await asyncio.wait([leaving])
                    await subscribed(publication, 1)
        await subscribed(publication, 0)
