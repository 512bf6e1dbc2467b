from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

import pytest

from gateway.ros1.xmlrpc.client import AT_A_HOST, IN_ALL, CallSlots
from tests.waiting import until


async def take(places: CallSlots, taken: list[str], leave: asyncio.Event, host: str) -> None:
    async with places.at(host):
        taken.append(host)
        await leave.wait()


async def test_one_host_takes_no_other_ones_places() -> None:
    places, leave, taken = CallSlots(), asyncio.Event(), list[str]()
    async with asyncio.TaskGroup() as group:
        for _ in range(AT_A_HOST + 5):
            group.create_task(take(places, taken, leave, "off"))
        await until(lambda: len(taken) == AT_A_HOST, "all places at one host are taken")
        async with places.at("on"):
            assert len(taken) == AT_A_HOST
        leave.set()
    assert len(taken) == AT_A_HOST + 5


async def test_there_are_so_many_places_in_all() -> None:
    places = CallSlots()
    async with AsyncExitStack() as held:
        for n in range(IN_ALL):
            await held.enter_async_context(places.at(f"host{n}"))
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0), places.at("another"):
                raise AssertionError("one too many")
    async with places.at("another"):
        assert len(places._at) == 1  # hosts that nobody calls are forgotten
