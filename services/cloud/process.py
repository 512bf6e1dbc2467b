"""The cloud process: join the bus, work."""

import logging
from concurrent.futures import ThreadPoolExecutor

from bus import open_bus
from services.cloud.settings import CloudSettings
from services.cloud.worker import Worker

log = logging.getLogger(__name__)


async def run(settings: CloudSettings) -> None:
    """Run a worker until cancelled."""
    with ThreadPoolExecutor(1, thread_name_prefix="cloud") as executor:
        async with open_bus(settings) as bus:
            log.info("cloud worker %s is ready", settings.worker)
            await Worker(bus, settings, executor).run()
