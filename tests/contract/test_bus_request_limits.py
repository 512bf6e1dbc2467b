"""Requests have limits: of time, and of how many wait and are served at once."""

import asyncio

import pytest

from bus import (
    Bus,
    RefusedError,
    RequestTimeoutError,
)
from tests.contract.requesting import KEY, Hanging, ask, until_served
from tests.waiting import PATIENCE_S, until


async def test_a_server_that_hangs_holds_nobody_longer_than_asked(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    hanging = Hanging()
    async with there.serve(KEY, hanging, at_once=1, waiting=1):
        await until_served(here, KEY, hanging)
        while b"hangs" not in hanging.begun:  # on a busy machine its time is up before it is begun
            with pytest.raises(RequestTimeoutError, match=r"^no answer within 0\.3 s"):
                await here.request(KEY, b"hangs", timeout_s=0.3)
        await until(lambda: hanging.cancelled == hanging.begun.count(b"hangs"))
        hanging.release.set()
        assert await ask(here, b"after") == b"after"


async def test_a_request_whose_time_is_up_before_its_turn_is_not_begun(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    hanging = Hanging()
    async with there.serve(KEY, hanging, at_once=1, waiting=2), asyncio.TaskGroup() as group:
        await until_served(here, KEY, hanging)
        first = group.create_task(here.request(KEY, b"first", timeout_s=PATIENCE_S))
        await until(lambda: b"first" in hanging.begun)
        with pytest.raises(RequestTimeoutError):
            await here.request(KEY, b"second", timeout_s=0.1)
        await asyncio.sleep(0.1)
        hanging.release.set()
        assert (await first).payload == b"first"
        assert await ask(here, b"third") == b"third"
    assert hanging.begun == [b"", b"first", b"third"]


async def test_so_many_at_once_so_many_waiting_and_the_rest_is_refused(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    hanging = Hanging()
    async with there.serve(KEY, hanging, at_once=2, waiting=1), asyncio.TaskGroup() as group:
        await until_served(here, KEY, hanging)
        hanging.begun.clear()
        asked = [group.create_task(here.request(KEY, b"%d" % n, timeout_s=PATIENCE_S)) for n in range(3)]
        await until(lambda: len(hanging.begun) == 2)
        with pytest.raises(RefusedError, match="busy: 3 requests are under way already"):
            await here.request(KEY, timeout_s=PATIENCE_S)
        assert hanging.begun == [b"0", b"1"]
        hanging.release.set()
        assert [(await each).payload for each in asked] == [b"0", b"1", b"2"]
