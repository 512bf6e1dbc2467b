"""What `bus.api` promises about requests, held against the fake, two peers, and two clients of an embedded router."""

import asyncio
from contextlib import AsyncExitStack

import pytest

from bus import (
    MAX_REQUEST_BYTES,
    MAX_TIMEOUT_S,
    Bus,
    BusClosedError,
    BusError,
    Handler,
    NotServedError,
    RefusedError,
    Reply,
    Request,
)
from bus.requests.serving import INTERNAL
from tests.contract.conftest import Opener
from tests.contract.requesting import KEY, Hanging, ask, until_served
from tests.waiting import PATIENCE_S, until


async def echo(request: Request) -> Reply:
    return Reply(request.payload)


async def test_a_request_arrives_as_it_was_and_so_does_the_reply(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    seen: list[Request] = []

    async def handler(request: Request) -> Reply:
        seen.append(request)
        return Reply(b"answer", "e/f;g")

    async with there.serve(KEY, handler):
        await ask(here)
        reply = await here.request(KEY, bytearray(b"question"), encoding="a/b;c", timeout_s=PATIENCE_S)
    assert reply == Reply(b"answer", "e/f;g")
    assert (seen[-1].key, seen[-1].payload, seen[-1].encoding) == (KEY, b"question", "a/b;c")
    assert type(reply.payload) is type(seen[-1].payload) is bytes
    assert seen[0].encoding == "application/octet-stream"
    assert seen[0].received_ns <= seen[-1].received_ns


async def test_a_bus_answers_itself(buses: tuple[Bus, Bus]) -> None:
    here, _ = buses
    async with here.serve(KEY, echo):
        assert await ask(here, b"x") == b"x"


async def test_whole_frames_arrive_as_requests_and_replies(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    frame = bytes(range(256)) * (640 * 480 * 3 // 256)
    async with there.serve(KEY, echo):
        for _ in range(3):
            assert await ask(here, frame) == frame


async def test_what_is_too_large_is_an_error_at_once(buses: tuple[Bus, Bus]) -> None:
    here, there = buses

    async def handler(request: Request) -> Reply:
        return Reply(bytes(int(request.payload)))

    async with there.serve(KEY, handler):
        assert await ask(here, b"0") == b""
        with pytest.raises(RefusedError, match="the reply has 16777217 bytes, at most 16777216 are sent"):
            await here.request(KEY, b"%d" % (MAX_REQUEST_BYTES + 1), timeout_s=PATIENCE_S)
    with pytest.raises(BusError, match="a request of 16777217 bytes, at most 16777216 are sent"):
        await here.request(KEY, bytes(MAX_REQUEST_BYTES + 1), timeout_s=1)


async def test_the_largest_request_and_reply_arrive(opener: Opener) -> None:
    largest = bytes(MAX_REQUEST_BYTES)
    async with opener() as bus, bus.serve(KEY, echo):
        assert await ask(bus, largest) == largest


async def test_nobody_serves_the_key(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with there.serve("fleet/r2/clock", echo):
        with pytest.raises(NotServedError, match=r"^no server has this key"):
            await here.request(KEY, timeout_s=PATIENCE_S)
    await until_not_served(here, "fleet/r2/clock")


async def until_not_served(bus: Bus, key: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                await bus.request(key, timeout_s=PATIENCE_S)
            except NotServedError:
                return


async def test_a_server_of_many_keys_knows_which_one(buses: tuple[Bus, Bus]) -> None:
    here, there = buses

    async def handler(request: Request) -> Reply:
        return Reply(request.key.encode())

    async with there.serve("fleet/r1/service/**", handler):
        assert await ask(here, key="fleet/r1/service/reset") == b"fleet/r1/service/reset"
        assert await ask(here, key="fleet/r1/service/arm/stop") == b"fleet/r1/service/arm/stop"
        with pytest.raises(NotServedError):
            await here.request("fleet/r2/service/reset", timeout_s=PATIENCE_S)


async def test_a_servers_refusal_is_the_callers_error_in_one_line(buses: tuple[Bus, Bus]) -> None:
    here, there = buses

    async def handler(_: Request) -> Reply:
        raise RefusedError("the motor\n is hot " + "!" * 1000)

    async with there.serve(KEY, handler):
        with pytest.raises(RefusedError, match=r"^the motor is hot !+$") as caught:
            await ask(here)
    assert len(str(caught.value)) == 500


async def test_a_servers_failure_says_no_more_than_that(
    buses: tuple[Bus, Bus], caplog: pytest.LogCaptureFixture
) -> None:
    here, there = buses

    async def handler(request: Request) -> Reply:
        if request.payload:
            return Reply(request.payload)
        raise TimeoutError("secret")

    async with there.serve(KEY, handler):
        with pytest.raises(RefusedError) as caught:
            await ask(here)
        assert str(caught.value) == INTERNAL
        assert await ask(here, b"next") == b"next"
    assert [record.getMessage() for record in caplog.records if record.exc_info] == [f"{KEY}: a request failed"]


async def test_a_key_that_two_serve_is_answered_once_and_by_the_other_when_one_goes(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    answered = 0

    def counting(name: bytes) -> Handler:
        async def handler(_: Request) -> Reply:
            nonlocal answered
            answered += 1
            return Reply(name)

        return handler

    async with AsyncExitStack() as nearer, there.serve(KEY, counting(b"farther")):
        await ask(here)
        await nearer.enter_async_context(here.serve(KEY, counting(b"nearer")))
        before = answered
        replies = {await ask(bus) for bus in buses for _ in range(20)}
        assert answered - before == 40
        assert replies <= {b"nearer", b"farther"}
        await nearer.aclose()
        assert {await ask(bus) for bus in buses for _ in range(20)} == {b"farther"}


async def test_a_bus_serves_a_key_once(opener: Opener) -> None:
    async with opener() as bus, bus.serve("fleet/r1/*", echo):
        with pytest.raises(BusError, match=r"this bus serves keys of fleet/\*/clock already"):
            async with bus.serve("fleet/*/clock", echo):
                pytest.fail("this must not be entered")
        async with bus.serve("fleet/r2/clock", echo):
            assert await ask(bus, b"x", key="fleet/r2/clock") == b"x"
        async with bus.serve("fleet/r2/clock", echo):
            pass


async def test_leaving_the_server_cancels_its_handlers_and_tells_who_waits(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    hanging = Hanging()
    async with asyncio.TaskGroup() as group:
        async with there.serve(KEY, hanging, at_once=1, waiting=1):
            await until_served(here, KEY, hanging)
            asked = [group.create_task(outcome(here)) for _ in range(2)]
            await until(lambda: len(hanging.begun) == 2)
        assert hanging.cancelled == 1
        assert [await each for each in asked] == ["NotServedError"] * 2


async def outcome(bus: Bus) -> str:
    try:
        await bus.request(KEY, timeout_s=PATIENCE_S)
    except BusError as error:
        return type(error).__name__
    return "answered"


async def test_a_caller_that_is_cancelled_harms_nobody(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    hanging = Hanging()
    async with there.serve(KEY, hanging):
        await until_served(here, KEY, hanging)
        asking = asyncio.create_task(here.request(KEY, b"given up", timeout_s=PATIENCE_S))
        await until(lambda: b"given up" in hanging.begun)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        hanging.release.set()
        assert await ask(here, b"next") == b"next"


async def test_so_many_requests_are_under_way_at_most(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    hanging = Hanging()
    async with there.serve(KEY, hanging, at_once=1, waiting=300), asyncio.TaskGroup() as group:
        await until_served(here, KEY, hanging)
        asked = [group.create_task(here.request(KEY, timeout_s=PATIENCE_S)) for _ in range(256)]
        await until(lambda: len(hanging.begun) == 2)
        with pytest.raises(BusError, match="256 requests are unanswered already"):
            await here.request(KEY, timeout_s=PATIENCE_S)
        hanging.release.set()
        assert len([await each for each in asked]) == 256
        assert await ask(here, b"again") == b"again"


@pytest.mark.parametrize("payload", ["text", memoryview(b"x"), None])
async def test_a_payload_is_bytes(buses: tuple[Bus, Bus], payload: bytes) -> None:
    here, _ = buses
    with pytest.raises(TypeError, match=type(payload).__name__):
        await here.request(KEY, payload, timeout_s=1)


@pytest.mark.parametrize("key", ["", "/a", "a//b", "a/*", "a/**", "a#b", "a?b"])
async def test_a_request_is_for_one_key(opener: Opener, key: str) -> None:
    async with opener() as bus:
        with pytest.raises(BusError):
            await bus.request(key, timeout_s=1)


@pytest.mark.parametrize("timeout_s", [0, -1, MAX_TIMEOUT_S + 0.1, float("nan"), float("inf")])
async def test_a_request_has_an_end(opener: Opener, timeout_s: float) -> None:
    async with opener() as bus:
        with pytest.raises(BusError, match="at most 60 s"):
            await bus.request(KEY, timeout_s=timeout_s)


async def test_what_a_server_serves_is_a_key_expression(opener: Opener) -> None:
    async with opener() as bus:
        with pytest.raises(BusError, match="not a key expression"):
            async with bus.serve("a//b", echo):
                pytest.fail("this must not be entered")


async def test_a_server_that_answers_nobody_is_a_mistake(opener: Opener) -> None:
    async with opener() as bus:
        for at_once, waiting in ((0, 1), (1, -1)):
            with pytest.raises(ValueError, match="a server handles at least 1 request"):
                async with bus.serve(KEY, echo, at_once=at_once, waiting=waiting):
                    pytest.fail("this must not be entered")


async def test_closing_the_bus_ends_requests_and_handlers(opener: Opener) -> None:
    hanging = Hanging()
    async with AsyncExitStack() as left_later:
        async with opener() as bus:
            await left_later.enter_async_context(bus.serve(KEY, hanging))
            await until_served(bus, KEY, hanging)
            asking = asyncio.create_task(bus.request(KEY, b"last", timeout_s=PATIENCE_S))
            await until(lambda: b"last" in hanging.begun)
        with pytest.raises((BusClosedError, NotServedError)):
            await asking
        await until(lambda: hanging.cancelled == 1)
        with pytest.raises(BusClosedError):
            await bus.request(KEY, timeout_s=1)
        with pytest.raises(BusClosedError):
            async with bus.serve(KEY, echo):
                pytest.fail("this must not be entered")
