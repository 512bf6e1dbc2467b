"""The distance process: join the bus, work."""

from concurrent.futures import ThreadPoolExecutor

from bus import open_bus
from services.distance.settings import DistanceSettings
from services.distance.worker import Worker


async def run(settings: DistanceSettings) -> None:
    """Run a worker until cancelled."""
    with ThreadPoolExecutor(1, thread_name_prefix="distance") as executor:
        async with open_bus(settings) as bus:
            await Worker(bus, settings, executor).run()
