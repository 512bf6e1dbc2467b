"""A detector worker whose model is a stand-in that takes a time per frame.

Arguments: router, name, milliseconds, and, of one that counts as on another machine, the file with its boot id.
"""

import asyncio
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from bus import BusSettings, clocks, open_bus
from schemas.tuning import Tuning
from schemas.worker_keys import WorkerAlive
from services.detector.model import DetectedObjects, Outcome, Request
from services.detector.process import DetectorWorker
from services.detector.worker_role import DETECTOR
from services.toolbox.process import run


class StandIn:
    """Finds nothing, in its own time, in one image after the other."""

    name = "stand-in"
    runtime = ""
    max_batch = 1
    in_flight = 1
    segments = False
    remarks: tuple[str, ...] = ()
    tuning = Tuning()
    classes: tuple[str, ...] = ()

    def __init__(self, frame_s: float) -> None:
        self._frame_s = frame_s

    def tune(self, tuning: Tuning) -> None:
        """See `Model.tune`."""
        self.tuning = tuning

    def close(self) -> None:
        """See `Model.close`."""

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        await asyncio.sleep(self._frame_s * len(batch))
        return [DetectedObjects([]) for _ in batch]


async def work(router: str, name: str, frame_s: float) -> None:
    """Work until cancelled."""
    async with open_bus(BusSettings(connect=[router], shared_memory=False)) as bus:
        await DetectorWorker(bus, StandIn(frame_s), [WorkerAlive(DETECTOR.service, name)]).run()


if __name__ == "__main__":
    if len(sys.argv) > 4:
        clocks.BOOT_ID = Path(sys.argv[4])
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    sys.exit(run(lambda: work(sys.argv[1], sys.argv[2], float(sys.argv[3]) / 1000)))
