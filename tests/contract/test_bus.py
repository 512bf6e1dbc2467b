"""What `bus.api` promises, held against the fake, two peers, and two clients of an embedded router."""

import asyncio
from typing import Final

import pytest

from bus import LATEST, QUEUE, SMALL_BYTES, SMALL_WAITING, Bus, Pieces, Presence, QoS, SubscriptionCounts
from tests.waiting import PATIENCE_S, next_of, until

KEY: Final = "fleet/r1/front/classes"
IMAGE_KEY: Final = "fleet/r1/front/color"
ONE_FRAME: Final = 640 * 480 * 3


async def test_what_is_put_arrives_as_it_was(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with here.subscribe(KEY, QUEUE(4)) as subscription, there.publisher(KEY, QoS.RESULT, encoding="a/b;c") as out:
        await until(lambda: out.wanted)
        out.put(b"bytes")
        out.put(bytearray(b"more"))
        out.put(b"")
        out.put(Pieces(b"in ", memoryview(b"pieces"), b"!"))
        samples = [await next_of(subscription) for _ in range(4)]
        assert [sample.payload for sample in samples] == [b"bytes", b"more", b"", b"in pieces!"]
        assert {(sample.key, sample.encoding, sample.replaced) for sample in samples} == {(KEY, "a/b;c", 0)}
        assert all(type(sample.payload) is bytes for sample in samples)
        assert samples[0].received_ns <= samples[-1].received_ns
        assert (out.counts.put, out.counts.dropped) == (4, 0)
        assert subscription.counts == SubscriptionCounts(received=4, dropped=0)


@pytest.mark.parametrize("pieces", [True, False])
@pytest.mark.parametrize("history", [True, False])
async def test_whole_frames_arrive(buses: tuple[Bus, Bus], *, history: bool, pieces: bool) -> None:
    here, there = buses
    frame = bytes(range(256)) * (ONE_FRAME // 256)
    payload = Pieces(frame[:100], memoryview(bytearray(frame))[100:-7], frame[-7:]) if pieces else frame
    async with (
        here.subscribe("fleet/*/*/color", LATEST, history=history) as subscription,
        there.publisher(IMAGE_KEY, QoS.IMAGE) as images,
    ):
        await until(lambda: images.wanted)
        async with asyncio.timeout(PATIENCE_S):
            while subscription.counts.received < 3:  # images may be dropped
                images.put(payload)
                await asyncio.sleep(0.05)
        sample = await next_of(subscription)
        assert sample.payload == frame
        assert sample.encoding == "application/octet-stream"


async def test_small_messages_are_queued_and_not_kept(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    burst = [b"%d" % number for number in range(SMALL_WAITING)]
    async with here.subscribe(KEY, QUEUE(99)) as subscription, there.publisher(KEY, QoS.MESSAGE) as out:
        await until(lambda: out.wanted)
        for payload in burst:
            out.put(payload)
        assert [(await next_of(subscription)).payload for _ in burst] == burst
        assert (out.counts.put, out.counts.dropped) == (len(burst), 0)
        async with here.subscribe(KEY, QUEUE(9)) as late:
            out.put(b"now")
            assert (await next_of(late)).payload == b"now"


async def test_a_large_message_arrives_whole(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    large = bytes(range(256)) * (SMALL_BYTES // 128)
    async with here.subscribe(KEY, LATEST, history=False) as subscription, there.publisher(KEY, QoS.MESSAGE) as out:
        await until(lambda: out.wanted)
        async with asyncio.timeout(PATIENCE_S):
            while not subscription.counts.received:  # large ones may be dropped
                out.put(large)
                await asyncio.sleep(0.05)
        assert (await next_of(subscription)).payload == large


async def test_a_bus_hears_itself(buses: tuple[Bus, Bus]) -> None:
    here, _ = buses
    async with here.subscribe(KEY, LATEST) as subscription, here.publisher(KEY, QoS.STATUS) as out:
        await until(lambda: out.wanted)
        out.put(b"x")
        assert (await next_of(subscription)).payload == b"x"


@pytest.mark.parametrize("qos", list(QoS))
async def test_demand_comes_and_goes_with_wildcard_subscribers(buses: tuple[Bus, Bus], qos: QoS) -> None:
    here, there = buses
    heard: asyncio.Queue[bool] = asyncio.Queue()

    def on_demand(wanted: bool) -> None:  # noqa: FBT001 - the promised signature
        assert asyncio.get_running_loop() is loop
        heard.put_nowait(wanted)

    loop = asyncio.get_running_loop()
    async with there.publisher(KEY, qos, on_demand=on_demand) as out:
        assert not out.wanted
        async with here.subscribe("fleet/*/*/other", LATEST), here.subscribe("fleet/*/*/classes", LATEST):
            async with asyncio.timeout(PATIENCE_S):
                assert await heard.get() is True
            assert out.wanted
            async with there.subscribe("fleet/**", LATEST):
                pass
            assert out.wanted
        async with asyncio.timeout(PATIENCE_S):
            assert await heard.get() is False
        assert not out.wanted
        assert heard.empty()
        async with here.subscribe(KEY, LATEST):
            await until(lambda: out.wanted)
    assert not out.wanted


async def test_a_publisher_learns_of_a_subscriber_that_was_there_first(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with here.subscribe("fleet/**", LATEST):
        for _ in range(2):
            async with there.publisher(KEY, QoS.RESULT) as out, there.publisher(KEY, QoS.IMAGE) as same_key:
                await until(lambda: out.wanted and same_key.wanted)


async def test_latest_keeps_the_newest_of_each_key_and_counts(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with (
        here.subscribe("cam/*", LATEST) as subscription,
        there.publisher("cam/a", QoS.RESULT) as a,
        there.publisher("cam/b", QoS.RESULT) as b,
    ):
        await until(lambda: a.wanted and b.wanted)
        b.put(b"b0")
        for number in range(5):
            a.put(b"a%d" % number)
        await until(lambda: subscription.counts.received == 6)
        assert subscription.counts == SubscriptionCounts(received=6, dropped=4, unread=6)
        samples = {sample.key: sample for sample in [await next_of(subscription), await next_of(subscription)]}
        assert (samples["cam/a"].payload, samples["cam/a"].replaced) == (b"a4", 4)
        assert (samples["cam/b"].payload, samples["cam/b"].replaced) == (b"b0", 0)
        assert subscription.counts == SubscriptionCounts(received=6, dropped=4)
        a.put(b"a5")
        assert (await next_of(subscription)).replaced == 0


async def test_a_queue_keeps_order_and_counts_what_it_drops(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with here.subscribe(KEY, QUEUE(3)) as subscription, there.publisher(KEY, QoS.RESULT) as out:
        await until(lambda: out.wanted)
        for number in range(8):
            out.put(bytes([number]))
        await until(lambda: subscription.counts.received == 8)
        samples = [await next_of(subscription) for _ in range(3)]
        assert [(sample.payload[0], sample.replaced) for sample in samples] == [(5, 5), (6, 0), (7, 0)]
        assert subscription.counts == SubscriptionCounts(received=8, dropped=5)


async def test_what_waits_comes_in_batches_until_the_end(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with there.publisher(KEY, QoS.RESULT) as out:
        async with here.subscribe(KEY, QUEUE(5)) as subscription:
            await until(lambda: out.wanted)
            for number in range(8):
                out.put(bytes([number]))
            await until(lambda: subscription.counts.received == 8)
            batches = subscription.batches(3)
            batch = [(sample.payload[0], sample.replaced) for sample in await anext(batches)]
            assert batch == [(3, 3), (4, 0), (5, 0)]
            assert subscription.counts == SubscriptionCounts(received=8, dropped=3, unread=2)
            assert [sample.payload[0] for sample in await anext(batches)] == [6, 7]
            waiting = asyncio.create_task(anext(batches, None))
            out.put(b"more")
            assert [sample.payload for sample in await asyncio.wait_for(waiting, PATIENCE_S) or ()] == [b"more"]
        assert [batch async for batch in batches] == []


async def test_results_of_one_publisher_keep_their_order(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with here.subscribe("fleet/**", QUEUE(100)) as subscription, there.publisher(KEY, QoS.RESULT) as out:
        await until(lambda: out.wanted)
        for number in range(60):
            out.put(bytes([number]))
        samples = [await next_of(subscription) for _ in range(60)]
        assert [sample.payload[0] for sample in samples] == list(range(60))
        arrived = [sample.received_ns for sample in samples]
        assert arrived == sorted(set(arrived)), "what came at once has no order in time"


async def test_put_does_not_wait_for_a_reader_that_does_not_read(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with (
        here.subscribe(IMAGE_KEY, QUEUE(2), history=False) as stuck,
        there.publisher(IMAGE_KEY, QoS.IMAGE) as images,
    ):
        await until(lambda: images.wanted)
        frame = bytes(ONE_FRAME)
        for _ in range(300):
            images.put(frame)
            await asyncio.sleep(0)
        images.put(b"end")
        await until(lambda: stuck.counts.received + images.counts.dropped > 0)
        counts = images.counts
        assert counts.put == 301
        assert counts.dropped <= 300
        assert (await next_of(stuck)).key == IMAGE_KEY


@pytest.mark.parametrize("few", [False, True])
async def test_what_was_put_before_leaving_arrives(buses: tuple[Bus, Bus], few: bool) -> None:  # noqa: FBT001
    here, there = buses
    async with here.subscribe("fleet/**", QUEUE(9), few=few) as subscription:
        async with there.publisher(KEY, QoS.RESULT) as out:
            await until(lambda: out.wanted)
            out.put(b"goodbye")
        assert (await next_of(subscription)).payload == b"goodbye"


@pytest.mark.parametrize("few", [False, True])
async def test_presence_there_already_appearing_vanishing(buses: tuple[Bus, Bus], few: bool) -> None:  # noqa: FBT001
    here, there = buses
    async with there.announce("workers/w1/alive"), here.watch("workers/*/alive", few=few) as watch:
        assert await next_of(watch) == Presence("workers/w1/alive", alive=True)
        async with here.announce("workers/w2/alive"):
            assert await next_of(watch) == Presence("workers/w2/alive", alive=True)
        assert await next_of(watch) == Presence("workers/w2/alive", alive=False)
        async with there.announce("robots/r1/alive"), there.announce("workers/w3/alive"):
            assert await next_of(watch) == Presence("workers/w3/alive", alive=True)


async def test_tokens_make_no_demand(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with there.publisher(KEY, QoS.RESULT) as out, there.announce(KEY), here.watch("**") as watch:
        seen = await next_of(watch)
        assert seen == Presence(KEY, alive=True)
        assert not out.wanted


async def test_many_readers_of_one_key(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with (
        here.subscribe(KEY, LATEST) as one,
        here.subscribe("fleet/**", QUEUE(5)) as two,
        there.subscribe("**/classes", LATEST) as three,
        there.publisher(KEY, QoS.RESULT) as out,
    ):
        await until(lambda: out.wanted)
        async with here.publisher("ping", QoS.RESULT), there.subscribe("ping", LATEST):
            pass
        out.put(b"x")
        assert [(await next_of(each)).payload for each in (one, two, three)] == [b"x"] * 3
