"""A session that Zenoh leaves cut off, here by hour-long pauses between its own attempts."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final

import pytest
import zenoh

from bus import QUEUE, Bus, BusSettings, Presence, Publisher, QoS, open_bus, session
from bus.config import session_config
from bus.declarations import ZenohWatch
from tests.bus.sessions import LEASE_S, ROUTER, answer, bus_threads, client, router, running
from tests.contract.conftest import free_endpoint
from tests.contract.waiting import next_of, until
from tests.integration.severed import Severable, severable

KEY: Final = "fleet/r1/front/classes"
KEPT: Final = 3


def of_one_that_gives_up(settings: BusSettings) -> dict[str, Any]:
    config = session_config(settings)
    config["connect"]["retry"] = {"period_init_ms": 3_600_000, "period_max_ms": 3_600_000}
    return config


@pytest.fixture(autouse=True)
def _zenoh_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "session_config", of_one_that_gives_up)
    monkeypatch.setattr(session, "CUT_OFF_S", 0.5)


@asynccontextmanager
async def behind_a_relay() -> AsyncIterator[tuple[str, Severable, Bus, Publisher]]:
    """A router's endpoint, and a publisher whose link to it can be cut."""
    endpoint = free_endpoint()
    async with (
        running(ROUTER, endpoint, str(LEASE_S)),
        severable(int(endpoint.rpartition(":")[2])) as relay,
        open_bus(client(f"tcp/127.0.0.1:{relay.port}")) as there,
        there.publisher(KEY, QoS.RESULT) as out,
    ):
        yield endpoint, relay, there, out


async def test_who_stays_cut_off_joins_anew_and_everything_is_there_again(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "SHORT_LIVED_S", 0.0)
    caplog.set_level(logging.WARNING, logger="bus")
    endpoint = free_endpoint()
    async with (
        open_bus(client(endpoint)) as here,
        open_bus(client(endpoint)) as there,
        there.publisher(KEY, QoS.RESULT, kept=KEPT) as out,
        there.announce("worker"),
        there.serve("question", answer),
        here.subscribe(KEY, QUEUE(9)) as subscription,
        here.subscribe(KEY, QUEUE(9), history=False) as live,
        here.watch("worker") as watch,
    ):
        for turn in range(2):
            async with running(ROUTER, endpoint, str(LEASE_S)):
                assert await next_of(watch) == Presence("worker", alive=True)
                await until(lambda: out.wanted and not here.link_problem)
                assert (await here.request("question", b"ping", timeout_s=9)).payload == b"ping"
                out.put(b"%d" % turn)
                while (await next_of(subscription)).payload != b"%d" % turn:  # what was kept may come again
                    pass
                assert (await next_of(live)).payload == b"%d" % turn  # never what was kept
            assert await next_of(watch) == Presence("worker", alive=False)
            await until(lambda: not out.wanted)
    assert sum("though a router answers" in record.getMessage() for record in caplog.records) >= 2
    await until(lambda: bus_threads() == [])


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


async def test_a_router_that_loses_a_link_at_once_is_given_more_time(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, logger="bus")
    async with (
        behind_a_relay() as (endpoint, relay, there, out),
        open_bus(client(endpoint)) as here,
        here.subscribe(KEY, QUEUE(9)) as subscription,
    ):
        for lease_s in (4, 16):
            await until(lambda: out.wanted and not there.link_problem)
            relay.sever()
            relay.mend()
            await until(lambda: f"with a lease of {lease_s} s: the link was lost soon" in caplog.text)  # noqa: B023
        await until(lambda: out.wanted)
        out.put(b"x")
        assert (await next_of(subscription)).payload == b"x"


async def test_what_was_wanted_of_a_session_before_is_not_for_ever(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, logger="bus")
    async with behind_a_relay() as (endpoint, relay, there, out):
        async with open_bus(client(endpoint)) as here, here.subscribe(KEY, QUEUE(9)):
            await until(lambda: out.wanted and not there.link_problem)
            relay.sever()
        relay.mend()
        await until(lambda: "joined" in caplog.text and not there.link_problem)
        await until(lambda: not out.wanted)


async def test_whom_nobody_watches_any_more_is_not_there_until_seen_again() -> None:
    endpoint = free_endpoint()
    async with open_bus(router(endpoint)) as bus, bus.announce("worker"):
        own = zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(client(endpoint)))))
        watch = ZenohWatch("worker", asyncio.get_running_loop(), few=True)
        for _ in range(2):
            watch.declare(own)
            assert await next_of(watch) == Presence("worker", alive=True)
            watch.undeclare()
            assert await next_of(watch) == Presence("worker", alive=False)
        own.close()


async def test_while_nobody_answers_a_session_stays(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, logger="bus")
    endpoint = free_endpoint()
    async with open_bus(client(endpoint)) as bus, bus.publisher(KEY, QoS.RESULT) as out:
        async with running(ROUTER, endpoint, str(LEASE_S)):
            await until(lambda: not bus.link_problem)
        await until(lambda: bus.link_problem)
        async with open_bus(client(free_endpoint())):  # as long as some attempts take
            out.put(b"x")
    assert not [record for record in caplog.records if "anew" in record.getMessage()]
