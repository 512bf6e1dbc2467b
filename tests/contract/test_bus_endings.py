"""How using a bus ends, and what it refuses, held against the fake, two peers, and two clients of a router."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from typing import Final, TypeVar

import pytest

from bus import LATEST, QUEUE, Bus, BusClosedError, BusError, Presence, QoS, Queue
from tests.contract.conftest import Opener
from tests.waiting import next_of, until

KEY: Final = "fleet/r1/front/classes"

T = TypeVar("T")


async def test_leaving_ends_the_iteration(buses: tuple[Bus, Bus]) -> None:
    here, _ = buses
    async with here.subscribe("**", LATEST) as subscription, here.watch("**") as watch:
        reading = asyncio.gather(collect(subscription), collect(watch))
        await asyncio.sleep(0)
    samples, presences = await reading
    assert (len(samples), len(presences)) == (0, 0)
    assert await collect(subscription) == []


async def collect(source: AsyncIterator[T]) -> list[T]:
    return [item async for item in source]


async def test_an_iteration_that_was_cancelled_can_go_on(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with here.subscribe(KEY, LATEST) as subscription, there.publisher(KEY, QoS.RESULT) as out:
        waiting = asyncio.create_task(next_of(subscription))
        await asyncio.sleep(0)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        await until(lambda: out.wanted)
        out.put(b"x")
        assert (await next_of(subscription)).payload == b"x"


async def test_two_tasks_cannot_share_an_iteration(buses: tuple[Bus, Bus]) -> None:
    here, _ = buses
    async with here.subscribe(KEY, LATEST) as subscription:
        waiting = asyncio.create_task(next_of(subscription))
        await asyncio.sleep(0)
        with pytest.raises(BusError, match="two tasks"):
            await anext(subscription)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting


async def test_it_is_known_by_its_certificates_name_or_has_none(
    buses: tuple[Bus, Bus], with_certificate: AbstractAsyncContextManager[Bus]
) -> None:
    async with with_certificate as known:
        assert (known.certificate, *(bus.certificate for bus in buses)) == ("gpu1", "", "")


async def test_put_after_leaving_is_refused(buses: tuple[Bus, Bus]) -> None:
    here, _ = buses
    async with here.publisher(KEY, QoS.RESULT) as out:
        pass
    with pytest.raises(BusClosedError, match=KEY):
        out.put(b"x")


@pytest.mark.parametrize("payload", ["text", memoryview(b"x"), None, 1])
async def test_a_payload_is_bytes(buses: tuple[Bus, Bus], payload: bytes) -> None:
    here, _ = buses
    async with here.publisher(KEY, QoS.RESULT) as out:
        with pytest.raises(TypeError, match=type(payload).__name__):
            out.put(payload)
        assert out.counts.put == 0


@pytest.mark.parametrize("key", ["", "/a", "a/", "a//b", "a/*", "a/**", "a/$*b", "a#b", "a?b"])
async def test_a_key_is_a_key(buses: tuple[Bus, Bus], key: str) -> None:
    here, _ = buses
    with pytest.raises(BusError):
        await refused(here.publisher(key, QoS.IMAGE))
    with pytest.raises(BusError):
        await refused(here.announce(key))


@pytest.mark.parametrize("key_expr", ["", "/a", "a/", "a//b", "a/***", "a*", "a#b"])
async def test_a_key_expression_is_one(buses: tuple[Bus, Bus], key_expr: str) -> None:
    here, _ = buses
    with pytest.raises(BusError):
        await refused(here.subscribe(key_expr, LATEST))
    with pytest.raises(BusError):
        await refused(here.watch(key_expr))


async def refused(context: AbstractAsyncContextManager[object]) -> None:
    async with context:
        pytest.fail("this must not be entered")


def test_a_queue_holds_something() -> None:
    with pytest.raises(ValueError, match="must be at least 1"):
        QUEUE(0)
    assert QUEUE(1) == Queue(1)


async def test_closing_the_bus_ends_everything_on_it(opener: Opener) -> None:
    async with AsyncExitStack() as left_later:
        async with opener() as bus:
            subscription = await left_later.enter_async_context(bus.subscribe("**", LATEST))
            watch = await left_later.enter_async_context(bus.watch("**"))
            out = await left_later.enter_async_context(bus.publisher(KEY, QoS.RESULT))
            await left_later.enter_async_context(bus.announce(KEY))
            await until(lambda: out.wanted)
            assert await next_of(watch) == Presence(KEY, alive=True)
            reading = asyncio.gather(collect(subscription), collect(watch))
            await asyncio.sleep(0)
        samples, presences = await reading
        assert (len(samples), len(presences)) == (0, 0)
        assert not out.wanted
        with pytest.raises(BusClosedError):
            out.put(b"x")
        for context in (bus.subscribe("**", LATEST), bus.watch("**"), bus.publisher(KEY, QoS.IMAGE), bus.announce(KEY)):
            with pytest.raises(BusClosedError):
                await refused(context)


async def test_members_that_hear_each_other_have_a_link_until_they_leave(opener: Opener) -> None:
    async with opener() as bus:
        assert bus.link_problem == ""
    assert bus.link_problem == "the bus is closed"
