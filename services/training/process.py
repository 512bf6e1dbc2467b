"""The training run as a command: progress on stderr, work off the event loop."""

import asyncio
import logging
import threading
from typing import Final

from rich.console import Console

from services.simulator import progress_bars
from services.training import parallel
from services.training.evaluation.predictor import PredictorLoader
from services.training.photographs import doubts_of
from services.training.refining.refinement import Refinement
from services.training.run import train
from services.training.settings import TrainingSettings

log = logging.getLogger(__name__)

ENDING_S: Final = 1.5
"""Seconds for an interrupted training to record its cost."""


async def run(settings: TrainingSettings, load: PredictorLoader, refinement: Refinement) -> None:
    """Train. After an interruption, the next run with the same settings resumes from the last checkpoint.

    load: loads the weights as a detector would, to evaluate them. refinement: that detector's.

    Raises:
        TrainingError: the work directory belongs to a run with other settings.
    """
    for doubt in await asyncio.to_thread(lambda: list(doubts_of(settings.data))):
        log.warning("%s", doubt)
    with progress_bars.progress(Console(stderr=True)) as report:
        cancelled = threading.Event()

        def progress(stage: str, done: int, total: int) -> None:
            if cancelled.is_set():
                raise asyncio.CancelledError
            report(stage, done, total)

        training = asyncio.ensure_future(asyncio.to_thread(train, settings, progress, load, refinement))
        try:
            await asyncio.shield(training)
        except asyncio.CancelledError:
            cancelled.set()  # the thread notices where it next reports
            parallel.end()
            ended, _ = await asyncio.wait([training], timeout=ENDING_S)
            for each in ended:
                if not each.cancelled():
                    each.exception()
            raise
    Console().print(f"wrote {settings.output} and its card beside it", markup=False, highlight=False, soft_wrap=True)
