"""The cloud process: join the bus, work."""

import logging
from concurrent.futures import ThreadPoolExecutor

from bus import open_bus
from services.cloud.settings import CloudSettings
from services.cloud.worker import Worker

log = logging.getLogger(__name__)


async def run(settings: CloudSettings) -> None:
    """Run a worker until cancelled. Leaving does not wait for what is being cut out: that may take seconds."""
    executor = ThreadPoolExecutor(1, thread_name_prefix="cloud")
    try:
        async with open_bus(settings) as bus:
            log.info("cloud worker %s is ready", settings.worker)
            await Worker(bus, settings, executor).run()
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
