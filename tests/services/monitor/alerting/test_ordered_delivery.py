import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from services.monitor.alerting import robots as module
from services.monitor.alerting.robots import Lanes
from tests.contract.waiting import until


class Receivers:
    """Receivers that take a message when they are told to."""

    def __init__(self) -> None:
        self.began: list[tuple[str, int]] = []
        self.open = {"a": asyncio.Event(), "b": asyncio.Event()}
        self.given_up: list[tuple[str, bool]] = []
        self.lanes: Lanes[str, int] = Lanes(self.deliver, lambda *said: self.given_up.append(said))

    async def deliver(self, receiver: str, message: int) -> None:
        self.began.append((receiver, message))
        await self.open[receiver].wait()


@asynccontextmanager
async def delivering() -> AsyncIterator[Receivers]:
    receivers = Receivers()
    running = asyncio.create_task(receivers.lanes.run())
    try:
        yield receivers
    finally:
        running.cancel()
        await asyncio.wait([running])


async def test_each_receiver_gets_its_messages_in_order_and_waits_for_no_other() -> None:
    async with delivering() as receivers:
        for message in range(3):
            receivers.lanes.put("a", message)
            receivers.lanes.put("b", message)
        receivers.open["b"].set()
        await until(lambda: receivers.began == [("a", 0), ("b", 0), ("b", 1), ("b", 2)])
        receivers.open["a"].set()
        await until(lambda: receivers.began[4:] == [("a", 1), ("a", 2)])
        receivers.lanes.put("a", 3)
        await until(lambda: receivers.began[-1] == ("a", 3))


async def test_so_many_deliver_at_once_and_the_others_come_after(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "AT_ONCE", 1)
    async with delivering() as receivers:
        receivers.lanes.put("a", 1)
        receivers.lanes.put("b", 1)
        await until(lambda: receivers.began == [("a", 1)])
        receivers.open["a"].set()
        await until(lambda: receivers.began == [("a", 1), ("b", 1)])


async def test_what_waits_is_bounded_and_the_oldest_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_WAITING", 2)
    receivers = Receivers()
    for message in range(4):
        receivers.lanes.put("a", message)
    assert receivers.given_up == [("a", True), ("a", False)]
    receivers.open["a"].set()
    running = asyncio.create_task(receivers.lanes.run())
    await until(lambda: receivers.began == [("a", 2), ("a", 3)])
    running.cancel()
    await asyncio.wait([running])
