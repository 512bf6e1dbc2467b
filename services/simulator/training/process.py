"""The training command: the run in a thread of its own, its progress on stderr."""

import asyncio
import logging
import sys
import threading
from typing import TextIO

from services.simulator.training.errors import TrainingError
from services.simulator.training.run import train
from services.simulator.training.settings import TrainingSettings

log = logging.getLogger(__name__)


class _StoppedError(Exception):
    """Ends the run's thread where it next reports its progress."""


class ProgressLines:
    """Writes one line for every percent of a stage; on a terminal it is the same line over again."""

    def __init__(self, stream: TextIO, stop: threading.Event) -> None:
        self._stream = stream
        self._stop = stop
        self._last = ("", -1)

    def __call__(self, stage: str, done: int, total: int) -> None:
        if self._stop.is_set():
            raise _StoppedError
        shown = (stage, 100 * done // total)
        if shown == self._last:
            return
        self._last = shown
        end = "\r" if self._stream.isatty() and done < total else "\n"
        self._stream.write(f"{stage:<9} {shown[1]:3d} % ({done} of {total}){end}")
        self._stream.flush()


async def run(settings: TrainingSettings) -> int:
    """Train until done or cancelled; what was done is kept in the work directory. Returns the exit code."""
    stop = threading.Event()
    try:
        await asyncio.to_thread(train, settings, ProgressLines(sys.stderr, stop))
    except TrainingError as error:
        log.error("%s", error)  # noqa: TRY400 - the message is for the user, who has no use for a trace
        return 1
    finally:
        stop.set()
    log.info("%s is ready, with its model card beside it", settings.output)
    return 0
