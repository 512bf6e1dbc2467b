import asyncio
from collections.abc import AsyncIterator

import pytest

from bus import QUEUE, SMALL_BYTES, Bus
from bus.fake import FakeNetwork
from gateway.to_bus.shaping.stream_output import unshaped
from gateway.to_bus.subscriptions import MAX_BYTES, MAX_PUBLISHERS, Latched, latching
from schemas import codec
from schemas.header import Header
from schemas.keys import RobotStreamKey
from schemas.ros import Text
from tests.waiting import until

STREAM = RobotStreamKey("r1", "text/mode")
KEY = str(STREAM)
ENCODING = codec.encoding(Text)
HALF = MAX_BYTES // 2


def text(said: str) -> Text:
    header = Header(robot="r1", boot_id="boot", seq=0, stamp_ns=0, frame_id="", received_ns=0)
    return Text(header=header, text=said)


@pytest.fixture
async def bus() -> AsyncIterator[Bus]:
    async with FakeNetwork().open_bus() as opened:
        yield opened


@pytest.fixture
async def latched(bus: Bus) -> AsyncIterator[Latched]:
    async with latching(bus, STREAM, "/mode", ENCODING, unshaped) as latched:
        yield latched


async def kept(bus: Bus, count: int) -> set[str]:
    """Return what a late subscriber gets."""
    async with bus.subscribe(KEY, QUEUE(MAX_PUBLISHERS + 1)) as late, asyncio.timeout(60):
        return {codec.decode(Text, (await anext(late)).payload, ENCODING).text for _ in range(count)}


async def opened(latched: Latched) -> None:
    await until(lambda: not any(kept.waiting for kept in latched._kept.values()), "all are handed over")


async def test_each_publishers_last_message_is_kept_until_it_is_forgotten(bus: Bus) -> None:
    async with latching(bus, STREAM, "/mode", ENCODING, unshaped) as latched:
        for publisher, said in (("a", "a0"), ("b", "b0"), ("a", "a1")):
            assert latched.put(publisher, text(said), 1)
        await opened(latched)
        assert latched.dropped == 0
        assert await kept(bus, 2) == {"a1", "b0"}
        assert latched.put("b", text("b1"), 1)
        assert await kept(bus, 2) == {"a1", "b1"}
        assert latched.counts.bytes == 4 * len(codec.encode(text("a1")))
        latched.forget("a")
        latched.forget("never there")
        await asyncio.sleep(0.01)
        assert latched.counts.bytes == 4 * len(codec.encode(text("a1")))
        assert await kept(bus, 1) == {"b1"}
    async with bus.subscribe(KEY, QUEUE(9)) as late:
        assert late.counts.received == 0


async def test_small_messages_are_queued_and_of_large_ones_the_newest_goes(bus: Bus, latched: Latched) -> None:
    said = [str(number) for number in range(10)]
    async with bus.subscribe(KEY, QUEUE(99)) as early:
        for each in said:
            assert latched.put("a", text(each), SMALL_BYTES)
            assert latched.put("b", text(each), SMALL_BYTES + 1)
        await opened(latched)
        assert latched.dropped == 9
        async with asyncio.timeout(60):
            heard = [codec.decode(Text, (await anext(early)).payload, ENCODING).text for _ in range(11)]
        assert sorted(heard) == sorted([*said, "9"])
        latched.put("b", text("smaller"), 1)
        await opened(latched)
        assert await kept(bus, 2) == {"9", "smaller"}


async def test_a_publisher_more_than_there_is_room_for_is_told_so(
    bus: Bus, latched: Latched, caplog: pytest.LogCaptureFixture
) -> None:
    names = {str(number) for number in range(MAX_PUBLISHERS)}
    assert all(latched.put(name, text(name), 1) for name in names)
    assert latched.problem == ""
    assert not latched.put("one more", text("x"), 7)
    assert not latched.put("and one more", text("x"), 1)
    assert latched.problem == (
        "a latched message of 7 bytes is not kept for late subscribers: at most 64 publishers' are, of 64 MiB together"
    )
    await opened(latched)
    assert await kept(bus, MAX_PUBLISHERS) == names
    latched.forget("0")
    assert latched.put("one more", text("x"), 1)
    assert [record.name for record in caplog.records].count("gateway.to_bus.subscriptions") == 1
    assert caplog.records[-1].getMessage() == f"{KEY}, /mode: {latched.problem}"


async def test_what_is_kept_is_bounded_together_and_an_old_message_never_outlives_a_newer_one(
    bus: Bus, latched: Latched
) -> None:
    assert latched.put("a", text("half"), HALF)
    assert latched.put("b", text("other half"), HALF)
    assert latched.put("a", text("half again"), HALF)
    assert not latched.put("a", text("too much"), HALF + 1)
    await opened(latched)
    assert await kept(bus, 1) == {"other half"}
    assert latched.put("a", text("small"), 1)
    await opened(latched)
    assert await kept(bus, 2) == {"other half", "small"}
