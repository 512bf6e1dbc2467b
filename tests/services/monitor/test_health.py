import asyncio

from bus.fake import FakeNetwork
from services.monitor.health import STALLED_S, Health


async def test_it_hears_itself() -> None:
    async with FakeNetwork().open_bus() as bus:
        health = Health(bus)
        health._heard_s -= 2 * STALLED_S
        assert health.problem.startswith("the bus has brought nothing for 2")
        running = asyncio.create_task(health.run())
        async with asyncio.timeout(5):
            while health.problem:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.01)
        running.cancel()
        await asyncio.wait([running])
    assert str(health.problem) == "the bus is closed"
