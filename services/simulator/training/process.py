"""The training run as a command: progress on the terminal, work off the event loop."""

import asyncio
import threading

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from services.simulator.training.evaluation.looking import Opener
from services.simulator.training.run import train
from services.simulator.training.settings import TrainingSettings


async def run(settings: TrainingSettings, opener: Opener) -> None:
    """Train. Interrupted, the next run with the same settings goes on from the last checkpoint.

    opener: loads the weights as a detector would, to evaluate them.

    Raises:
        TrainingError: the work directory belongs to a run with other settings.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns) as bars:
        stages: dict[str, TaskID] = {}
        cancelled = threading.Event()

        def progress(stage: str, done: int, total: int) -> None:
            if cancelled.is_set():
                raise asyncio.CancelledError
            if stage not in stages:
                stages[stage] = bars.add_task(stage, total=total)
            bars.update(stages[stage], completed=done, total=total)

        try:
            await asyncio.to_thread(train, settings, progress, opener)
        finally:
            cancelled.set()  # the thread notices where it next reports
    bars.console.print(f"wrote {settings.output} and its card beside it", highlight=False)
