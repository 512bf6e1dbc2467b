import asyncio
from collections.abc import AsyncIterator

import pytest

from bus import QUEUE, Bus
from bus.fake import FakeNetwork
from gateway.latching import MAX_BYTES, MAX_PUBLISHERS, Latched, latching
from tests.gateway.ros1.waiting import until

KEY = "fleet/r1/ros/map"


@pytest.fixture
async def bus() -> AsyncIterator[Bus]:
    async with FakeNetwork().open_bus() as opened:
        yield opened


async def kept(bus: Bus, count: int) -> set[bytes]:
    """Return what a late subscriber gets."""
    async with bus.subscribe(KEY, QUEUE(MAX_PUBLISHERS + 1)) as late, asyncio.timeout(10):
        return {(await anext(late)).payload for _ in range(count)}


async def opened(latched: Latched) -> None:
    await until(lambda: not any(kept.waiting for kept in latched._kept.values()), "all are handed over")


async def test_each_publishers_last_message_is_kept_until_it_is_forgotten(bus: Bus) -> None:
    async with latching(bus, KEY, "a/b") as latched:
        for publisher, payload in (("a", b"a0"), ("b", b"b0"), ("a", b"a1")):
            assert latched.put(publisher, payload)
        await opened(latched)
        assert latched.dropped == 1
        assert await kept(bus, 2) == {b"a1", b"b0"}
        assert latched.put("b", b"b1")
        assert await kept(bus, 2) == {b"a1", b"b1"}
        latched.forget("a")
        latched.forget("never there")
        await asyncio.sleep(0.01)
        async with bus.subscribe(KEY, QUEUE(9)) as late:
            assert (await anext(late)).payload == b"b1"
            assert late.counts.received == 1
    async with bus.subscribe(KEY, QUEUE(9)) as late:
        assert late.counts.received == 0


async def test_a_publisher_more_than_there_is_room_for_is_told_so(bus: Bus, caplog: pytest.LogCaptureFixture) -> None:
    async with latching(bus, KEY, "a/b") as latched:
        payloads = {b"%d" % number for number in range(MAX_PUBLISHERS)}
        assert all(latched.put(payload.decode(), payload) for payload in payloads)
        assert latched.problem == ""
        assert not latched.put("one more", b"x")
        assert not latched.put("and one more", b"x")
        assert "at most 64 publishers" in latched.problem
        await opened(latched)
        assert await kept(bus, MAX_PUBLISHERS) == payloads
        latched.forget("0")
        assert latched.put("one more", b"x")
    assert len(caplog.messages) == 1


async def test_what_is_kept_is_bounded_together_and_an_old_message_never_outlives_a_newer_one(bus: Bus) -> None:
    half = bytes(MAX_BYTES // 2)
    async with latching(bus, KEY, "a/b") as latched:
        assert latched.put("a", half)
        assert latched.put("b", half)
        assert latched.put("a", half)
        assert not latched.put("a", half + b"x")
        await opened(latched)
        assert await kept(bus, 1) == {half}
        assert latched.put("a", b"small")
        await opened(latched)
        assert await kept(bus, 2) == {half, b"small"}
