"""The detector process: load the model, join the bus, work."""

import asyncio
import logging
import tempfile
from pathlib import Path
from typing import Final

from bus import open_bus
from services.detector.leaving import Leaving
from services.detector.model import Model, ModelError
from services.detector.requests import answering
from services.detector.role import DETECTOR, OPINION
from services.detector.runtime.loading import load_all, tracking
from services.detector.settings import DetectorSettings
from services.detector.worker import Worker
from services.worker.thread import worker_thread

log = logging.getLogger(__name__)

FAILED: Final = 1


async def run(settings: DetectorSettings) -> int:
    """Run a worker until cancelled; see `work`. It announces itself only once its model works.

    Raises:
        ModelError: the model cannot be used.
    """
    with (
        tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder,
        worker_thread("loading") as executor,
    ):
        log.info("loading %s", settings.model)
        model = await asyncio.get_running_loop().run_in_executor(executor, load_all, settings, Path(folder))
        log.info("%s is ready; worker %s", model.name, settings.worker)
        for remark in model.remarks:
            log.warning("%s", remark)
        try:
            return await work(settings, model)
        finally:
            model.close()


async def work(settings: DetectorSettings, model: Model) -> int:
    """Serve with a model that works until cancelled; when it works no longer, log why and return the exit code."""
    role = OPINION if settings.opinion else DETECTOR
    tokens, leaving = settings.tokens(role.service), Leaving()
    following = None if role.lists_only else tracking(settings, model)
    try:
        async with open_bus(settings) as bus, answering(bus, model, settings.worker, role, leaving):
            worker = Worker(
                bus, model, tokens, role=role, tracking=following, max_age_s=settings.max_age_s, leaving=leaving
            )
            await worker.run()
    except* ModelError as failed:
        log.error("%s", _first(failed))  # noqa: TRY400 - the reason is known: no stack says more
    finally:
        if following is not None:
            following.close()
    return FAILED


def _first(failed: BaseExceptionGroup[ModelError]) -> ModelError:
    first = failed.exceptions[0]
    return _first(first) if isinstance(first, BaseExceptionGroup) else first
