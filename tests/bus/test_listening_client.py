"""Clients of a router to which others connect, as robots' gateways are."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Final

import pytest

from bus import LATEST, QUEUE, Bus, BusError, BusSettings, Presence, QoS, Subscription, open_bus
from bus.session import config, listening_client
from tests.bus.sessions import LEASE_S, ROUTER, Numbering, answer, bus_threads, client, router, running
from tests.contract.conftest import free_endpoint
from tests.integration.network.severed import Severable, severable
from tests.waiting import next_of, until

KEY: Final = "fleet/r1/front/classes"
TOKENS: Final = 20


def gateway(central: str, own: str) -> BusSettings:
    return BusSettings(connect=[central], listen=[own], lease_s=LEASE_S)


def without_memory(settings: BusSettings) -> BusSettings:
    """Return settings with which all bytes cross the link."""
    return settings.model_copy(update={"shared_memory": False})


def port_of(endpoint: str) -> int:
    return int(endpoint.rpartition(":")[2])


async def test_an_endpoint_that_is_taken_is_an_error_at_once() -> None:
    own = free_endpoint()
    async with open_bus(router(own)):
        with pytest.raises(BusError) as caught:
            async with open_bus(gateway(free_endpoint(), own)):
                pytest.fail("this must not be entered")
    assert str(caught.value) == f"cannot open the bus as a client (listen {own}): Address already in use"
    await until(lambda: bus_threads() == [])


async def test_without_a_folder_to_write_to_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bus.session.listening_client.os.access", lambda *_: True)
    monkeypatch.setattr(listening_client, "MEMORY", "/no/such/folder")
    with pytest.raises(BusError, match=r"^cannot open the bus as a client .*No such file or directory"):
        async with open_bus(gateway(free_endpoint(), free_endpoint())):
            pytest.fail("this must not be entered")


async def test_the_first_router_that_answers_is_used_and_another_one_after_it() -> None:
    first, second, own = free_endpoint(), free_endpoint(), free_endpoint()
    settings = BusSettings(connect=[first, second], listen=[own], lease_s=LEASE_S)
    async with (
        open_bus(settings) as robot,
        robot.announce("robot"),
        open_bus(client(own)) as beside,
        beside.serve("question", answer),
    ):
        assert robot.link_problem == f"there is no link to {first}, {second}"
        for endpoint in (second, first, second):
            async with open_bus(router(endpoint)) as centre, centre.watch("robot") as watch:
                assert await next_of(watch) == Presence("robot", alive=True)
                await until(lambda: not robot.link_problem)
                assert (await centre.request("question", b"ping", timeout_s=9)).payload == b"ping"
            await until(lambda: bool(robot.link_problem))


@pytest.mark.parametrize("_", range(3))
async def test_after_a_move_to_another_router_nothing_is_wanted_that_nobody_wants(_: int) -> None:
    first, second, third, own = (free_endpoint() for _ in range(4))
    async with open_bus(router(second)), AsyncExitStack() as at_first, AsyncExitStack() as at_third:
        await at_first.enter_async_context(open_bus(router(first)))
        await at_third.enter_async_context(open_bus(router(third).model_copy(update={"connect": [second]})))
        async with (
            open_bus(BusSettings(connect=[first, second], listen=[own], lease_s=LEASE_S)) as robot,
            robot.publisher(KEY, QoS.IMAGE) as published,
            open_bus(client(third)) as elsewhere,
            elsewhere.subscribe(KEY, LATEST, history=False) as seen,
            open_bus(client(own)) as beside,
        ):
            async with beside.subscribe(KEY, LATEST, history=False):
                await until(lambda: published.wanted)
                await at_first.aclose()
                hearing = asyncio.create_task(next_of(seen))
                while not hearing.done():  # by then it has moved, and the router there told it of who is elsewhere
                    published.put(b"x")
                    await asyncio.sleep(0.02)
                await at_third.aclose()
                await asyncio.sleep(LEASE_S / 2)
            await until(lambda: not published.wanted)


@asynccontextmanager
async def behind_a_relay() -> AsyncIterator[tuple[str, Severable, Bus, str]]:
    """A router's endpoint, a robot's bus whose link to it can be cut, and the robot's own endpoint."""
    endpoint, own = free_endpoint(), free_endpoint()
    async with (
        running(ROUTER, endpoint, str(LEASE_S)),
        severable(port_of(endpoint)) as relay,
        open_bus(gateway(f"tcp/127.0.0.1:{relay.port}", own)) as robot,
    ):
        yield endpoint, relay, robot, own


async def test_a_link_that_is_cut_costs_the_neighbours_nothing_and_the_centre_gets_the_rest_once_and_in_order() -> None:
    async with behind_a_relay() as (endpoint, relay, robot, own), AsyncExitStack() as stack:
        near = await stack.enter_async_context(open_bus(client(own)))
        far = await stack.enter_async_context(open_bus(client(endpoint)))
        out = await stack.enter_async_context(near.publisher(KEY, QoS.RESULT, kept=1_000))
        heard = await stack.enter_async_context(robot.subscribe(KEY, QUEUE(10_000), recover=1_000))
        central = await stack.enter_async_context(far.subscribe(KEY, QUEUE(10_000), recover=1_000))
        await stack.enter_async_context(robot.announce("robot"))
        watch = await stack.enter_async_context(far.watch("robot"))
        assert await next_of(watch) == Presence("robot", alive=True)
        await until(lambda: out.wanted)
        numbering = Numbering(out)
        for _ in range(3):
            relay.sever()
            await until(lambda: robot.link_problem)
            assert not near.link_problem
            assert await next_of(watch) == Presence("robot", alive=False)
            relay.mend()
            await until(lambda: not robot.link_problem)
            assert await next_of(watch) == Presence("robot", alive=True)
            so_far = numbering.count
            await until(partial(_has, central, so_far))
        numbering.end()
        assert [(await next_of(heard)).payload for _ in numbering.sent] == numbering.sent
        assert [(await next_of(central)).payload for _ in numbering.sent] == numbering.sent
        assert (heard.counts.missed, central.counts.missed) == (0, 0)


def _has(subscription: Subscription, number: int) -> bool:
    return subscription.counts.received >= number


async def test_a_robot_that_joins_is_told_no_more_where_there_are_more_robots() -> None:
    endpoint = free_endpoint()
    cost: list[int] = []
    async with running(ROUTER, endpoint, str(LEASE_S)), AsyncExitStack() as fleet:
        for others in (2, 20):
            for number in range(others):
                await _robot(fleet, endpoint, f"r{others}-{number}")
            async with (
                open_bus(client(endpoint)) as centre,
                centre.watch("fleet/**") as watch,
                severable(port_of(endpoint)) as relay,
                AsyncExitStack() as own,
            ):
                await _robot(own, f"tcp/127.0.0.1:{relay.port}", "joining")
                seen: set[str] = set()
                while len([key for key in seen if key.startswith("fleet/joining/")]) < TOKENS:
                    seen.add((await next_of(watch)).key)
                await asyncio.sleep(LEASE_S / 2)
                cost.append(relay.received)
    assert cost[1] < 1.5 * cost[0], cost  # signs of life are of no even number


async def _robot(stack: AsyncExitStack, endpoint: str, name: str) -> None:
    bus = await stack.enter_async_context(open_bus(gateway(endpoint, free_endpoint())))
    for number in range(TOKENS):
        await stack.enter_async_context(bus.announce(f"fleet/{name}/camera{number}/color/alive"))


async def test_a_link_that_zenoh_has_given_up_is_made_anew(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, logger="bus")
    monkeypatch.setattr(config, "RETRY", config.NO_RETRY)
    monkeypatch.setattr(listening_client, "CHECKED_S", 0.3)
    central, own = free_endpoint(), free_endpoint()
    async with open_bus(gateway(central, own)) as robot, robot.announce("robot"):
        async with open_bus(router(central)) as centre, centre.watch("robot") as watch:
            assert await next_of(watch) == Presence("robot", alive=True)
            await until(lambda: not robot.link_problem)
        assert f"opening a new session: {central} takes links, and this one has none" in caplog.messages


@pytest.mark.parametrize("prefix", ["", "fleet/r1"])
async def test_what_only_services_beside_a_robot_want_does_not_leave_it(prefix: str) -> None:
    centre, own = free_endpoint(), free_endpoint()
    depth, color, size = "fleet/r1/front/depth", "fleet/r1/front/color", 500_000
    async with (
        open_bus(router(centre)) as central,
        severable(port_of(centre)) as link,
        open_bus(without_memory(gateway(f"tcp/127.0.0.1:{link.port}", own)), prefix=prefix) as robot,
        open_bus(client(own)) as beside,
        beside.subscribe(depth, QUEUE(100)) as near,
        central.subscribe(color, QUEUE(100)) as far,
        robot.publisher(depth, QoS.IMAGE) as depths,
        robot.publisher(color, QoS.IMAGE) as colors,
    ):
        await until(lambda: depths.wanted and colors.wanted)
        colors.put(b"first")
        assert (await next_of(far)).payload == b"first"
        link.sent = 0
        for number in range(5):
            depths.put(bytes([number]) * size)
            assert bytes((await next_of(near)).payload[:1]) == bytes([number])
        colors.put(b"last")
        assert (await next_of(far)).payload == b"last"
        assert link.sent < size, "no depth image went to the centre"
