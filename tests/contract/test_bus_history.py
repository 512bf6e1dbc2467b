"""A bus keeps the last of each key for subscribers that come late."""

from contextlib import AsyncExitStack
from typing import Final

import pytest

from bus import QUEUE, Bus, QoS, SubscriptionCounts
from tests.waiting import next_of, until

KEY: Final = "fleet/r1/front/classes"
IMAGE_KEY: Final = "fleet/r1/front/color"
ONE_FRAME: Final = 640 * 480 * 3


@pytest.mark.parametrize("qos", [QoS.LATCHED, QoS.RESULT, QoS.STATUS])
async def test_a_late_subscriber_gets_the_last_of_each_key_once(buses: tuple[Bus, Bus], qos: QoS) -> None:
    here, there = buses
    keys = [f"fleet/r{number}/front/classes" for number in range(5)]
    async with AsyncExitStack() as stack:
        publishers = [await stack.enter_async_context(there.publisher(key, qos)) for key in keys]
        for publisher in publishers:
            publisher.put(b"old")
            publisher.put(b"last")
        await all_sent(there)
        async with here.subscribe("fleet/*/*/classes", QUEUE(20)) as subscription:
            samples = [await next_of(subscription) for _ in keys]
            assert sorted(sample.key for sample in samples) == keys
            assert {sample.payload for sample in samples} == {b"last"}
            for publisher in publishers:
                publisher.put(b"live")
            assert {(await next_of(subscription)).payload for _ in keys} == {b"live"}
            assert subscription.counts == SubscriptionCounts(received=10, dropped=0)


async def test_what_a_publisher_kept_comes_in_order_to_a_late_subscriber_that_asks_for_it(
    buses: tuple[Bus, Bus],
) -> None:
    here, there = buses
    async with there.publisher(KEY, QoS.RESULT, kept=3) as out:
        for number in range(5):
            out.put(bytes([number]))
        await all_sent(there)
        async with (
            here.subscribe(KEY, QUEUE(9), recover=4) as some,
            here.subscribe(KEY, QUEUE(9), recover=2) as two,
            here.subscribe(KEY, QUEUE(9)) as last,
        ):
            older = [await next_of(some) for _ in range(3)]
            assert [(each.payload[0], each.kept) for each in older] == [(2, True), (3, True), (4, True)]
            assert [(await next_of(two)).payload[0] for _ in range(2)] == [3, 4]
            assert (await next_of(last)).payload[0] == 4
            out.put(b"live")
            for subscription in (some, two, last):
                live = await next_of(subscription)
                assert (live.payload, live.kept) == (b"live", False)
            assert some.counts == SubscriptionCounts(received=4, dropped=0)


async def test_a_publisher_may_keep_none(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with there.publisher(KEY, QoS.STATUS, kept=0) as out:
        async with here.subscribe(KEY, QUEUE(9)) as first:
            await until(lambda: out.wanted)
            out.put(b"0")
            assert (await next_of(first)).payload == b"0"
        await until(lambda: not out.wanted)
        async with here.subscribe(KEY, QUEUE(9)) as second:
            await until(lambda: out.wanted)
            out.put(b"1")
            assert (await next_of(second)).payload == b"1"


@pytest.mark.parametrize("qos", [QoS.LATCHED, QoS.RESULT])
async def test_each_of_several_publishers_of_one_key_keeps_its_last(buses: tuple[Bus, Bus], qos: QoS) -> None:
    here, there = buses
    maps = {bytes([name]) * ONE_FRAME for name in b"ab"}
    async with AsyncExitStack() as stack:
        plain = await stack.enter_async_context(there.publisher(KEY, QoS.IMAGE))
        for last in maps:
            publisher = await stack.enter_async_context(there.publisher(KEY, qos))
            publisher.put(last)
        await all_sent(there)
        async with here.subscribe(KEY, QUEUE(9)) as first:
            assert {(await next_of(first)).payload for _ in maps} == maps
            await until(lambda: plain.wanted)
            async with here.subscribe(KEY, QUEUE(9)) as second, there.subscribe("fleet/**", QUEUE(9)) as third:
                for late in (second, third):
                    assert {(await next_of(late)).payload for _ in maps} == maps
            async with there.publisher(KEY, qos) as late_publisher:
                late_publisher.put(b"c")
                assert (await next_of(first)).payload == b"c"
            plain.put(b"live")
            assert (await next_of(first)).payload == b"live"
            async with here.subscribe(KEY, QUEUE(9)) as last_one:
                assert {(await next_of(last_one)).payload for _ in maps} == maps
                plain.put(b"end")
                assert (await next_of(last_one)).payload == b"end"
            assert first.counts == SubscriptionCounts(received=5, dropped=0, unread=1)


async def test_what_is_put_at_once_reaches_those_who_want_no_history(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with there.publisher(KEY, QoS.IMAGE) as plain, here.subscribe(KEY, QUEUE(9), history=False) as subscription:
        await until(lambda: plain.wanted)
        for number in range(5):
            async with there.publisher(KEY, QoS.LATCHED) as out:
                out.put(bytes([number]))
            assert (await next_of(subscription)).payload == bytes([number])


async def test_there_is_no_history_of_images_nor_for_who_wants_none(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with there.publisher(KEY, QoS.RESULT) as out, there.publisher(IMAGE_KEY, QoS.IMAGE) as images:
        out.put(b"last")
        images.put(b"last")
        await all_sent(there)
        async with (
            here.subscribe(KEY, QUEUE(9), history=False) as no_history,
            here.subscribe(IMAGE_KEY, QUEUE(9)) as image,
        ):
            await until(lambda: out.wanted and images.wanted)
            out.put(b"live")
            images.put(b"live")
            assert (await next_of(no_history)).payload == b"live"
            assert (await next_of(image)).payload == b"live"


async def all_sent(bus: Bus) -> None:
    """Wait until what was put before is on its way: leaving a publisher says so, and results are served in turn."""
    for qos in QoS:
        async with bus.publisher("done", qos) as out:
            out.put(b"")
