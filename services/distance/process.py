"""The distance process: join the bus, work."""

import logging

from bus import open_bus
from services.distance.settings import DistanceSettings
from services.distance.worker import Worker
from services.worker.thread import worker_thread

log = logging.getLogger(__name__)


async def run(settings: DistanceSettings) -> None:
    """Run a worker until cancelled."""
    with worker_thread("distance") as executor:
        async with open_bus(settings) as bus:
            log.info("distance worker %s is ready", settings.worker)
            await Worker(bus, settings, executor).run()
