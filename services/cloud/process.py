"""The cloud process: join the bus, work."""

import logging

from bus import open_bus
from services.cloud.settings import CloudSettings
from services.cloud.worker import Worker
from services.worker.thread import worker_thread

log = logging.getLogger(__name__)


async def run(settings: CloudSettings) -> None:
    """Run a worker until cancelled."""
    with worker_thread("cloud") as executor:
        async with open_bus(settings) as bus:
            log.info("cloud worker %s is ready", settings.worker)
            await Worker(bus, settings, executor).run()
