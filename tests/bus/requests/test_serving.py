"""What the contract suite cannot arrange: arrivals around the end, and what a handler does against the rules."""

import asyncio

import pytest

from bus import Reply, Request
from bus.requests import serving as requests
from bus.requests.serving import INTERNAL, Call, Server
from tests.waiting import until

Outcome = Reply | str | None


def call(outcomes: list[Outcome], payload: bytes = b"", *, left_s: float = 10) -> Call:
    until_s = asyncio.get_running_loop().time() + left_s
    return Call(Request("key", payload, "", 0), until_s, outcomes.append)


async def echo(request: Request) -> Reply:
    await asyncio.sleep(0)
    return Reply(request.payload)


def server(handler: object = echo, at_once: int = 1, waiting: int = 1) -> Server:
    return Server("key", handler, asyncio.get_running_loop(), at_once, waiting)  # type: ignore[arg-type]


async def test_what_arrives_before_it_begins_is_answered_then() -> None:
    outcomes: list[Outcome] = []
    serving = server()
    serving.arrive(call(outcomes, b"early"))
    await asyncio.sleep(0)
    assert outcomes == []
    async with serving.serving():
        await until(lambda: bool(outcomes))
        assert outcomes == [Reply(b"early")]


async def test_what_arrives_after_its_end_is_let_go_at_once() -> None:
    outcomes: list[Outcome] = []
    serving = server()
    serving.end()
    serving.arrive(call(outcomes))
    assert outcomes == [None]


async def test_every_call_is_finished_once_whenever_the_end_comes() -> None:
    for turns in range(10):
        outcomes: list[Outcome] = []
        serving = server(at_once=2, waiting=2)
        async with serving.serving():
            for number in range(4):
                serving.arrive(call(outcomes, b"%d" % number))
            for _ in range(turns):
                await asyncio.sleep(0)
            serving.end()
        assert len(outcomes) == 4


async def test_requests_that_wait_have_so_many_bytes_together_and_one_alone_has_any(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(requests, "MAX_OPEN_BYTES", 10)
    outcomes: list[Outcome] = []
    serving = server(waiting=9)
    for payload in (b"eleven bytes", b"x"):
        serving.arrive(call(outcomes, payload))
    assert outcomes == ["busy: 1 requests are under way already, with all the bytes that there is room for"]
    async with serving.serving():
        await until(lambda: len(outcomes) == 2)
        for payload in (b"12345", b"67890", b"x"):
            serving.arrive(call(outcomes, payload))
        assert outcomes[2:] == ["busy: 2 requests are under way already, with all the bytes that there is room for"]
        await until(lambda: len(outcomes) == 5)
    assert outcomes[3:] == [Reply(b"12345"), Reply(b"67890")]


async def test_a_handler_that_breaks_the_rules_fails_alone() -> None:
    outcomes: list[Outcome] = []

    async def wrong(request: Request) -> Reply | None:
        if request.payload == b"cancel":
            raise asyncio.CancelledError
        return Reply(b"fine") if request.payload else None

    serving = server(wrong, waiting=3)
    async with serving.serving():
        for payload in (b"", b"cancel", b"good"):
            serving.arrive(call(outcomes, payload))
        await until(lambda: len(outcomes) == 3)
    assert outcomes == [INTERNAL, None, Reply(b"fine")]


async def test_a_call_whose_time_is_up_is_not_begun() -> None:
    outcomes: list[Outcome] = []
    serving = server()
    async with serving.serving():
        serving.arrive(call(outcomes, left_s=0))
        await until(lambda: bool(outcomes))
    assert outcomes == ["the request waited too long in the server's queue"]
