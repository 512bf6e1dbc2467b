"""A client's session ends with its link, and another one follows."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final

import pytest
import zenoh

from bus import QUEUE, Bus, Presence, Publisher, QoS, open_bus
from bus.history import caches
from bus.presence.listed_tokens import ListedTokens, ZenohWatch
from bus.session.config import session_config
from tests.bus.sessions import LEASE_S, ROUTER, Numbering, answer, bus_threads, client, router, running
from tests.contract.conftest import free_endpoint
from tests.integration.network.severed import Severable, severable
from tests.waiting import next_of, until

KEY: Final = "fleet/r1/front/classes"
KEPT: Final = 3
MANY: Final = 40


@asynccontextmanager
async def behind_a_relay() -> AsyncIterator[tuple[str, Severable, Bus, Publisher]]:
    """A router's endpoint, and a publisher whose link to it can be cut."""
    endpoint = free_endpoint()
    async with (
        running(ROUTER, endpoint, str(LEASE_S)),
        severable(int(endpoint.rpartition(":")[2])) as relay,
        open_bus(client(f"tcp/127.0.0.1:{relay.port}")) as there,
        there.publisher(KEY, QoS.RESULT, kept=1_000) as out,
    ):
        yield endpoint, relay, there, out


async def cut_for_a_while(relay: Severable, bus: Bus) -> None:
    relay.sever()
    await until(lambda: bus.link_problem)
    relay.mend()
    await until(lambda: not bus.link_problem)


async def test_everything_is_there_again_after_the_router_was_not() -> None:
    endpoint = free_endpoint()
    async with (
        open_bus(client(endpoint)) as here,
        open_bus(client(endpoint)) as there,
        there.serve("question", answer),
        there.publisher(KEY, QoS.RESULT, kept=KEPT) as out,
        there.announce("worker"),  # the last that is declared
        here.subscribe(KEY, QUEUE(9)) as subscription,
        here.subscribe(KEY, QUEUE(9), history=False) as live,
        here.watch("worker") as watch,
    ):
        for turn in range(3):
            async with running(ROUTER, endpoint, str(LEASE_S)):
                assert await next_of(watch) == Presence("worker", alive=True)
                await until(lambda: out.wanted and not here.link_problem)
                assert (await here.request("question", b"ping", timeout_s=9)).payload == b"ping"
                out.put(b"%d" % turn)
                assert (await next_of(subscription)).payload == b"%d" % turn  # what was kept does not come again
                assert (await next_of(live)).payload == b"%d" % turn
            assert await next_of(watch) == Presence("worker", alive=False)
            await until(lambda: not out.wanted)
    await until(lambda: bus_threads() == [])


async def test_all_that_is_kept_comes_once_and_in_order_whoever_was_cut_off() -> None:
    async with behind_a_relay() as (endpoint, relay, there, out), AsyncExitStack() as stack:
        own = await stack.enter_async_context(severable(int(endpoint.rpartition(":")[2])))
        here = await stack.enter_async_context(open_bus(client(f"tcp/127.0.0.1:{own.port}")))
        subscription = await stack.enter_async_context(here.subscribe(KEY, QUEUE(10_000), recover=1_000))
        await until(lambda: out.wanted)
        numbering = Numbering(out)
        for link, bus in ((relay, there), (own, here), (relay, there)):
            await cut_for_a_while(link, bus)
            await asyncio.sleep(0.2)
        numbering.end()
        await until(lambda: subscription.counts.received == numbering.count)
        got = [(await next_of(subscription)).payload for _ in numbering.sent]
        assert got == numbering.sent
        assert subscription.counts.missed == 0


async def test_a_publisher_that_ends_with_its_link_loses_nothing_if_it_is_opened_again() -> None:
    endpoint = free_endpoint()
    async with (
        running(ROUTER, endpoint, str(LEASE_S)),
        severable(int(endpoint.rpartition(":")[2])) as relay,
        open_bus(client(f"tcp/127.0.0.1:{relay.port}")) as there,
        open_bus(client(endpoint)) as here,
        here.subscribe(KEY, QUEUE(10_000), recover=1_000) as subscription,
    ):
        for turn in (b"1", b"2"):
            async with there.publisher(KEY, QoS.RESULT, kept=1_000) as out:
                await until(lambda: out.wanted)
                out.put(b"before " + turn)
                while (older := (await next_of(subscription)).payload) != b"before " + turn:
                    assert older == b"into a lost link 1"
                relay.sever()
                out.put(b"into a lost link " + turn)
                await until(lambda: there.link_problem)
            relay.mend()
            await until(lambda: not there.link_problem)
        async with there.publisher(KEY, QoS.RESULT, kept=1_000) as out:
            await until(lambda: out.wanted)
            out.put(b"after")
            got = [(await next_of(subscription)).payload for _ in range(2)]
        assert got == [b"into a lost link 2", b"after"]
        assert (subscription.counts.received, subscription.counts.missed) == (5, 0)


async def test_many_publishers_are_all_declared_and_all_their_histories_had() -> None:
    endpoint = free_endpoint()
    async with running(ROUTER, endpoint, str(LEASE_S)), open_bus(client(endpoint)) as there, AsyncExitStack() as stack:
        for number in range(MANY):
            out = await stack.enter_async_context(there.publisher(f"fleet/r{number}/front/classes", QoS.RESULT))
            out.put(b"%d" % number)
        async with (
            open_bus(client(endpoint)) as late,
            late.subscribe("fleet/*/front/classes", QUEUE(99)) as all_of_them,
        ):
            got = {int((await next_of(all_of_them)).payload) for _ in range(MANY)}
        assert got == set(range(MANY))


async def test_who_joins_anew_still_has_what_was_kept() -> None:
    endpoint = free_endpoint()
    async with open_bus(client(endpoint)) as there, there.publisher(KEY, QoS.RESULT, kept=KEPT) as out:
        async with running(ROUTER, endpoint, str(LEASE_S)):
            await until(lambda: not there.link_problem)
            for number in range(KEPT + 1):
                out.put(b"%d" % number)
        await until(lambda: there.link_problem)
        async with (
            running(ROUTER, endpoint, str(LEASE_S)),
            open_bus(client(endpoint)) as late,
            late.subscribe(KEY, QUEUE(9), recover=KEPT) as subscription,
        ):
            assert [(await next_of(subscription)).payload for _ in range(KEPT)] == [b"1", b"2", b"3"]


async def test_who_wants_the_last_has_no_more_of_what_a_publisher_takes_to_its_next_session() -> None:
    async with behind_a_relay() as (endpoint, relay, there, out), open_bus(client(endpoint)) as here:
        async with here.subscribe(KEY, QUEUE(999), recover=999) as first:
            for number in range(300):
                out.put(b"%d" % number)
            await until(lambda: first.counts.received == 300)
        async with here.subscribe(KEY, QUEUE(999)) as subscription:
            assert (await next_of(subscription)).payload == b"299"
            await cut_for_a_while(relay, there)
            await until(lambda: out.wanted)
            out.put(b"live")
            assert (await next_of(subscription)).payload == b"live"
            assert (subscription.counts.received, subscription.counts.missed) == (2, 0)


async def test_what_waits_for_a_publisher_that_ends_meanwhile_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint = free_endpoint()
    async with running(ROUTER, endpoint, str(LEASE_S)), AsyncExitStack() as stack:
        own = await stack.enter_async_context(severable(int(endpoint.rpartition(":")[2])))
        monkeypatch.setattr(caches, "ASKED_AT_ONCE", 0)  # no cache answers
        here = await stack.enter_async_context(open_bus(client(f"tcp/127.0.0.1:{own.port}")))
        async with open_bus(client(endpoint)) as there, there.publisher(KEY, QoS.RESULT, kept=KEPT) as out:
            await publish_alone(out, b"before", endpoint)
            subscription = await stack.enter_async_context(here.subscribe(KEY, QUEUE(9), recover=KEPT))
            await until(lambda: out.wanted)
            out.put(b"waits")
            await asyncio.sleep(LEASE_S / 2)
            assert subscription.counts.received == 0
            own.sever()
        own.mend()
        assert (await next_of(subscription)).payload == b"waits"


async def publish_alone(out: Publisher, payload: bytes, endpoint: str) -> None:
    """Publish a message, and return when it has gone through the router: who subscribes then has missed it."""
    async with open_bus(client(endpoint)) as bus, bus.subscribe(KEY, QUEUE(9), history=False) as live:
        await until(lambda: out.wanted)
        out.put(payload)
        assert (await next_of(live)).payload == payload
    await until(lambda: not out.wanted)


async def test_what_was_wanted_of_a_session_before_is_not_for_ever() -> None:
    async with behind_a_relay() as (endpoint, relay, there, out):
        async with open_bus(client(endpoint)) as here, here.subscribe(KEY, QUEUE(9)):
            await until(lambda: out.wanted and not there.link_problem)
            relay.sever()
        relay.mend()
        await until(lambda: not there.link_problem)
        await until(lambda: not out.wanted)


async def test_whom_nobody_watches_any_more_is_not_there_until_seen_again() -> None:
    endpoint = free_endpoint()
    async with open_bus(router(endpoint)) as bus, bus.announce("worker"):
        own = zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(client(endpoint)))))
        watch = ZenohWatch("worker", asyncio.get_running_loop(), ListedTokens("", lambda *_: None), few=True)
        for _ in range(2):
            watch.declare(own)
            assert await next_of(watch) == Presence("worker", alive=True)
            watch.undeclare()
            assert await next_of(watch) == Presence("worker", alive=False)
        own.close()
