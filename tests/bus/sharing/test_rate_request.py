import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from bus import QUEUE, Subscription
from bus.fake import FakeNetwork
from bus.sharing import rate_request
from bus.sharing.rate_request import RateRequest
from schemas import codec, consumer_keys
from schemas.budget import LEAST_HZ, MOST_WAIT_S, RateBudget
from schemas.keys import CameraKey, Stream, StreamKey
from tests.waiting import next_of

FRONT = CameraKey("r1", "front")


@asynccontextmanager
async def telling(asked: RateRequest) -> AsyncIterator[Subscription]:
    network = FakeNetwork()
    async with (
        network.open_bus() as ours,
        network.open_bus() as theirs,
        theirs.subscribe(consumer_keys.every_budget("r1"), QUEUE(9)) as budgets,
        asyncio.TaskGroup() as group,
    ):
        task = group.create_task(asked.tell(ours, StreamKey(FRONT, Stream.COLOR), "w1"))
        await asyncio.sleep(0)
        yield budgets
        task.cancel()


async def told(budgets: Subscription) -> RateBudget:
    sample = await next_of(budgets)
    assert consumer_keys.parse_budget(sample.key) == (FRONT, "w1")
    return codec.decode(RateBudget, sample.payload, sample.encoding)


def budget(hz: float | None, wait_s: float = 0.0) -> RateBudget:
    return RateBudget(robot="r1", camera="front", consumer="w1", stream="color", hz=hz, wait_s=wait_s)


async def test_nothing_is_said_until_there_is_a_limit_and_then_each_change() -> None:
    asked = RateRequest()
    async with telling(asked) as budgets:
        asked.ask(None)
        asked.ask(2.5, 0.4)
        assert await told(budgets) == budget(2.5, 0.4)
        asked.ask(None)
        assert await told(budgets) == budget(None)
        assert budgets.counts.received == 2


async def test_a_limit_that_was_there_before_is_said_at_once_and_without_its_wait() -> None:
    asked = RateRequest()
    async with telling(asked) as budgets:
        asked.ask(2, 0.4)
        await told(budgets)
    async with telling(asked) as budgets:
        assert await told(budgets) == budget(2)


async def test_a_limit_is_said_again_for_a_gateway_that_forgot_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rate_request, "REPEAT_S", 0.05)
    asked = RateRequest()
    async with telling(asked) as budgets:
        asked.ask(2.5, 0.4)
        assert [await told(budgets) for _ in range(3)] == [budget(2.5, 0.4), budget(2.5), budget(2.5)]
        asked.ask(None)
        while (await told(budgets)).hz is not None:
            pass
        received = budgets.counts.received
        await asyncio.sleep(0.2)
        assert budgets.counts.received == received, "and nothing once there is none"


async def test_a_gateway_that_comes_later_hears_a_limit_at_once() -> None:
    asked = RateRequest()
    asked.ask(2.5, 0.4)
    network = FakeNetwork()
    async with network.open_bus() as ours, network.open_bus() as theirs, asyncio.TaskGroup() as group:
        task = group.create_task(asked.tell(ours, StreamKey(FRONT, Stream.COLOR), "w1"))
        await asyncio.sleep(0.05)
        for expected in (budget(2.5, 0.4), budget(2.5)):
            async with theirs.subscribe(consumer_keys.every_budget("r1"), QUEUE(9), history=False) as budgets:
                assert await told(budgets) == expected
            await asyncio.sleep(0.05)
        task.cancel()


def test_it_is_known_when_the_next_one_is_wanted() -> None:
    asked = RateRequest()
    before_ns = time.time_ns()
    asked.ask(2.0, 0.4)
    assert before_ns + 400_000_000 <= asked.from_ns <= time.time_ns() + 400_000_000


async def test_what_is_asked_can_be_said() -> None:
    asked = RateRequest()
    asked.ask(1e-9, 1e9)
    async with telling(asked) as budgets:
        assert await told(budgets) == budget(LEAST_HZ, MOST_WAIT_S)
