"""The distance process: join the bus, work."""

import logging
from concurrent.futures import ThreadPoolExecutor

from bus import open_bus
from services.distance.settings import DistanceSettings
from services.distance.worker import Worker

log = logging.getLogger(__name__)


async def run(settings: DistanceSettings) -> None:
    """Run a worker until cancelled. Leaving does not wait for what is being measured: that may take seconds."""
    executor = ThreadPoolExecutor(1, thread_name_prefix="distance")
    try:
        async with open_bus(settings) as bus:
            log.info("distance worker %s is ready", settings.worker)
            await Worker(bus, settings, executor).run()
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
