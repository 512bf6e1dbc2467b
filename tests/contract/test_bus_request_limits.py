"""Requests have limits: of time, and of how many wait and are served at once."""

import asyncio
from typing import Final

import pytest

from bus import (
    Bus,
    NotServedError,
    RefusedError,
    Reply,
    Request,
    RequestTimeoutError,
)
from tests.contract.waiting import PATIENCE_S, until

KEY: Final = "fleet/r1/clock"


async def ask(bus: Bus, payload: bytes | bytearray = b"", *, key: str = KEY) -> bytes:
    """Ask until somebody serves the key: that somebody does travels to us too."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                return (await bus.request(key, payload, timeout_s=PATIENCE_S)).payload
            except NotServedError:
                await asyncio.sleep(0.01)


class Hanging:
    """A handler that waits until it is released, and says how often it was called and cancelled."""

    def __init__(self) -> None:
        self.begun: list[bytes] = []
        self.cancelled = 0
        self.release = asyncio.Event()

    async def __call__(self, request: Request) -> Reply:
        self.begun.append(request.payload)
        try:
            await self.release.wait()
        except asyncio.CancelledError:
            self.cancelled += 1
            raise
        return Reply(request.payload)


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


async def until_served(bus: Bus, key: str, hanging: Hanging) -> None:
    """Wait until a request reaches the handler; it is answered then."""
    hanging.release.set()
    await ask(bus, key=key)
    hanging.release.clear()


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
