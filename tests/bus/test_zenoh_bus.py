"""What only real sessions can show: routers that come, go and hang, processes that stop."""

import asyncio
import logging
import signal
from typing import Final, Literal, TypeVar

import pytest

from bus import LATEST, QUEUE, BusError, BusSettings, Presence, Publisher, QoS, Subscription, open_bus
from bus.delivery import batching
from bus.session import session
from tests.bus.sessions import LEASE_S, ROUTER, bus_threads, client, router, running
from tests.contract.conftest import free_endpoint
from tests.waiting import PATIENCE_S, next_of, until

KEY: Final = "fleet/r1/front/classes"
IMAGE_KEY: Final = "fleet/r1/front/color"
T = TypeVar("T")

PRESENT: Final = """
import asyncio, sys
from bus import BusSettings, open_bus

async def main() -> None:
    async with open_bus(BusSettings(connect=[sys.argv[1]], lease_s=float(sys.argv[2]))) as bus, bus.announce("worker"):
        print("ready", flush=True)
        await asyncio.Event().wait()

asyncio.run(main())
"""


def warnings_in(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [
        record.getMessage()
        for record in caplog.records
        if record.levelno == logging.WARNING and record.name.startswith("bus.")
    ]


async def test_a_client_waits_for_its_router(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="bus")
    endpoint = free_endpoint()
    async with (
        open_bus(client(endpoint)) as bus,
        bus.subscribe("fleet/**", QUEUE(9)) as subscription,
        bus.publisher(KEY, QoS.RESULT) as out,
        bus.publisher(IMAGE_KEY, QoS.IMAGE),
        bus.announce("worker"),
        bus.watch("*") as watch,
    ):
        assert not out.wanted
        out.put(b"early")
        await until(lambda: bool(warnings_in(caplog)))
        await asyncio.sleep(0.2)
        assert warnings_in(caplog) == [f"waiting for a link to {endpoint}: no Zenoh router answers there"]
        async with open_bus(router(endpoint)) as hub, hub.subscribe(KEY, QUEUE(9)) as at_hub:
            assert (await next_of(at_hub)).payload == b"early"
            assert (await next_of(subscription)).payload == b"early"
            assert await next_of(watch) == Presence("worker", alive=True)
            await until(lambda: out.wanted)
    await until(lambda: bus_threads() == [])


async def big_frame(images: Publisher, frames: Subscription) -> int:
    """Put images, which a busy link drops, until one arrives; return its size."""
    before = frames.counts.received
    async with asyncio.timeout(PATIENCE_S):
        while frames.counts.received == before:
            images.put(bytes(1_000_000))
            await asyncio.sleep(0.2)
    return len((await next_of(frames)).payload)


async def test_everything_is_there_again_after_a_router_restart(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="bus")
    endpoint = free_endpoint()
    async with (
        open_bus(client(endpoint)) as here,
        open_bus(client(endpoint)) as there,
        there.publisher(KEY, QoS.RESULT) as out,
        there.publisher(IMAGE_KEY, QoS.IMAGE) as images,
        there.announce("worker"),
        here.subscribe("fleet/*/*/classes", QUEUE(9)) as subscription,
        here.subscribe("fleet/*/*/color", LATEST, history=False) as frames,
        here.watch("worker") as watch,
    ):
        for turn in range(2):
            async with running(ROUTER, endpoint, str(LEASE_S)):
                assert await next_of(watch) == Presence("worker", alive=True)
                await until(lambda: out.wanted and images.wanted)
                if turn:
                    assert (await next_of(subscription)).payload == b"while away"
                out.put(b"%d" % turn)
                assert (await next_of(subscription)).payload == b"%d" % turn
                assert await big_frame(images, frames) == 1_000_000
            assert await next_of(watch) == Presence("worker", alive=False)
            await until(lambda: not out.wanted and not images.wanted)
            out.put(b"while away")
        assert subscription.counts.received == 3
    messages = [record.getMessage() for record in caplog.records]
    assert len([message for message in messages if message.startswith("lost the link")]) == 4


async def test_a_process_that_hangs_is_gone_after_the_lease_and_comes_back() -> None:
    endpoint = free_endpoint()
    async with (
        open_bus(router(endpoint)) as bus,
        bus.watch("worker") as watch,
        running(PRESENT, endpoint, str(LEASE_S)) as process,
    ):
        assert await next_of(watch) == Presence("worker", alive=True)
        process.send_signal(signal.SIGSTOP)
        assert await next_of(watch) == Presence("worker", alive=False)
        process.send_signal(signal.SIGCONT)
        assert await next_of(watch) == Presence("worker", alive=True)
        process.kill()
        assert await next_of(watch) == Presence("worker", alive=False)


async def test_a_router_that_hangs_holds_nobody_up(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, logger="asyncio")
    endpoint = free_endpoint()
    async with running(ROUTER, endpoint, "30") as hub:
        here_settings = BusSettings(connect=[endpoint], lease_s=30, shared_memory=False)
        async with (
            open_bus(here_settings) as here,
            open_bus(here_settings) as there,
            here.subscribe("fleet/**", LATEST),
            there.publisher(KEY, QoS.RESULT) as out,
            there.publisher(IMAGE_KEY, QoS.IMAGE) as images,
        ):
            await until(lambda: out.wanted and images.wanted)
            hub.send_signal(signal.SIGSTOP)
            for _ in range(100):
                out.put(b"x" * 1_000)
                images.put(bytes(1_000_000))
                await asyncio.sleep(0.01)
            async with there.announce("worker"), there.watch("**"), there.subscribe("**", LATEST):
                pass
    assert [record.getMessage() for record in caplog.records] == []
    await until(lambda: bus_threads() == [])


async def test_an_endpoint_that_is_taken_is_an_error_at_once() -> None:
    endpoint = free_endpoint()
    async with open_bus(router(endpoint)):
        settings = BusSettings(mode="router", listen=[free_endpoint(), endpoint])
        with pytest.raises(BusError) as caught:
            async with open_bus(settings):
                pytest.fail("this must not be entered")
        assert str(caught.value) == f"cannot open the bus as a router (listen {endpoint}): Address already in use"
    await until(lambda: bus_threads() == [])


async def test_an_endpoint_that_zenoh_panics_at_is_an_error_at_once() -> None:
    async with asyncio.timeout(PATIENCE_S):
        with pytest.raises(BusError, match="banana"):
            async with open_bus(BusSettings(connect=["tcp/127.0.0.1:7447?rel=banana"])):
                pass


async def test_a_router_that_comes_and_goes_is_told() -> None:
    endpoint = free_endpoint()
    async with open_bus(client(endpoint)) as bus:
        assert bus.link_problem == f"there is no link to {endpoint}"
        for _ in range(2):
            async with open_bus(router(endpoint)) as there:
                await until(lambda: not bus.link_problem)
                assert there.link_problem == ""
            await until(lambda: bool(bus.link_problem))
    assert bus.link_problem == "the bus is closed"


@pytest.mark.parametrize("mode", ["client", "router", "peer"])
async def test_a_robots_bus_waits_for_the_centre(
    mode: Literal["client", "router", "peer"], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, logger="bus")
    central, own = free_endpoint(), free_endpoint()
    settings = BusSettings(mode=mode, listen=[own], connect=[central], lease_s=LEASE_S)
    async with (
        open_bus(settings) as robot,
        open_bus(client(own)) as beside,
        beside.announce("beside"),
        robot.announce("robot"),
        robot.watch("beside") as watch,
    ):
        assert await next_of(watch) == Presence("beside", alive=True)
        assert robot.link_problem == f"there is no link to {central}"
        for _ in range(2):
            async with open_bus(router(central)) as centre, centre.watch("*") as present:
                assert {(await next_of(present)).key, (await next_of(present)).key} == {"beside", "robot"}
                await until(lambda: not robot.link_problem)
            await until(lambda: bool(robot.link_problem))
    ours = [
        record.getMessage().partition(" tcp/")[0] for record in caplog.records if record.name == "bus.session.session"
    ]
    assert ours.count("connecting to") == 1
    assert ours.count("lost the link to") == 2


@pytest.mark.parametrize("mode", ["client", "router", "peer"])
async def test_a_robots_bus_says_in_a_clients_words_what_it_waits_for(
    mode: Literal["client", "router", "peer"], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO, logger="bus")
    monkeypatch.setattr(session, "TELL_AFTER_S", 0.0)
    central, own = free_endpoint(), free_endpoint()
    async with open_bus(BusSettings(mode=mode, listen=[own], connect=[central], lease_s=LEASE_S)):
        await until(lambda: bool(warnings_in(caplog)))
        async with open_bus(router(central)):
            await until(lambda: f"connected to {central}" in caplog.messages)
        assert warnings_in(caplog)[0] == f"waiting for a link to {central}: no Zenoh router answers there"
        assert len([message for message in warnings_in(caplog) if message.startswith("waiting")]) == 1


async def test_a_link_to_somebody_else_is_not_the_one_that_was_sought_beside_scouting() -> None:
    central, own = free_endpoint(), free_endpoint()
    async with (
        open_bus(BusSettings(mode="peer", listen=[own], connect=[central], scouting=True)) as robot,
        open_bus(client(own)) as beside,
        beside.announce("beside"),
        robot.watch("beside") as watch,
    ):
        assert await next_of(watch) == Presence("beside", alive=True)
        assert robot.link_problem == f"there is no link to {central}"
        async with open_bus(router(central)):
            await until(lambda: not robot.link_problem)


async def test_what_few_send_takes_no_thread() -> None:
    async with open_bus(BusSettings(mode="peer", connect=[])) as bus:
        async with bus.watch("fleet/r1/**", few=True), bus.subscribe("fleet/r1/**", QUEUE(9), few=True):
            assert "bus-gathering" not in bus_threads()
        async with bus.watch("fleet/**"), bus.subscribe("fleet/**", QUEUE(9)):
            assert bus_threads().count("bus-gathering") == 3, "tokens, lists of tokens, messages"


async def test_what_a_publisher_keeps_does_not_overtake_what_came_live_and_waits_for_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(batching, "SHORTEST_S", batching.LONGEST_S)
    endpoint = free_endpoint()

    async def numbers_of(robot: str) -> list[int]:
        async with bus.publisher(f"fleet/{robot}/front/classes", QoS.RESULT) as out:
            await until(lambda: out.wanted)
            for number in range(30):
                out.put(bytes([number]))
            return [(await next_of(subscription)).payload[0] for _ in range(30)]

    async with (
        open_bus(router(endpoint)) as hub,
        open_bus(client(endpoint)) as bus,
        hub.subscribe("fleet/**", QUEUE(100)) as subscription,
    ):
        for joined in range(10):
            assert await numbers_of(f"r{joined}") == list(range(30))
