import asyncio
import socket

from bus import BusSettings, open_bus
from bus.fake import FakeNetwork
from services.monitor.health import Health
from services.monitor.liveness import STALLED_S
from tests.contract.conftest import free_endpoint
from tests.waiting import until


async def test_it_hears_itself() -> None:
    async with FakeNetwork().open_bus() as bus:
        health = Health(bus)
        health._heard_s -= 2 * STALLED_S
        assert health.problem.startswith("nothing has arrived on the bus for 2")
        assert health.heard_s() is None
        running = asyncio.create_task(health.run())
        async with asyncio.timeout(5):
            while health.problem:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.01)
        heard_s = health.heard_s()
        assert heard_s is not None
        await until(lambda: (health.heard_s() or 0) > heard_s)
        running.cancel()
        await asyncio.wait([running])
    assert str(health.problem) == "the bus is closed"
    assert health.heard_s() is None


async def test_what_others_link_to_hears_them_also_where_its_own_link_is_down() -> None:
    async with FakeNetwork().open_bus() as bus:
        cut_off, hub = Health(bus), Health(bus, hub=True)
    assert (cut_off.heard_s(), cut_off.problem) == (None, "the bus is closed")
    assert (hub.heard_s(), hub.problem) == (hub._heard_s, "the bus is closed")


async def test_a_listener_that_answers_nobody_is_noticed_while_heartbeats_go_on_and_when_it_answers_again() -> None:
    endpoint = free_endpoint()
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    settings = BusSettings(mode="router", listen=[endpoint], shared_memory=False)
    async with FakeNetwork().open_bus() as bus:
        health = Health(bus, settings=settings, probe_s=0.05)
        with socket.create_server((host, int(port))):  # the system takes connections, nobody answers on them
            running = asyncio.create_task(health.run())
            await until(lambda: health.problem.startswith(f"{endpoint} takes no new links: "))
            assert health.heard_s() is not None
        async with open_bus(settings):
            await until(lambda: not health.problem)
            running.cancel()
            await asyncio.wait([running])
