"""The detector process: load the model, join the bus, work."""

import asyncio
import logging
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from bus import open_bus
from services.detector.settings import DetectorSettings
from services.detector.ultralytics_model import load
from services.detector.worker import Worker

log = logging.getLogger(__name__)


async def run(settings: DetectorSettings) -> None:
    """Run a worker until cancelled. It announces itself only once its model works.

    Raises:
        ModelError: the model cannot be used.
    """
    with (
        tempfile.TemporaryDirectory(prefix="fleetsight-") as folder,
        ThreadPoolExecutor(1, thread_name_prefix="model") as executor,
    ):
        log.info("loading %s", settings.model)
        model = await asyncio.get_running_loop().run_in_executor(executor, load, settings, Path(folder))
        log.info("%s is ready; worker %s", model.name, settings.worker)
        async with open_bus(settings) as bus:
            await Worker(bus, model, settings.worker, executor).run()
