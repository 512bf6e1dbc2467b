"""A detector worker whose model is a stand-in: each of its class lists names a class of its own, which tells it apart.

The process, its bus, its sharing of cameras and all that it publishes are the detector's; only the model is none. It
finds a class that no other list has, a box with a mask in the middle of every image, and a pallet for PHASE_S in every
2 PHASE_S. Once a class list is handed to the bus a line of it is in the journal.

Arguments: `BusSettings` in JSON, the worker's name, the journal, milliseconds of a frame, and a file whose content
stands for another machine's boot id, as images stay raw on one machine.
"""

import itertools
import logging
import os
import sys
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from pycocotools import mask as coco

from benchmarks.chaos.accounts import MARK, PALLET, Published
from benchmarks.peers.stand_in_worker import StandIn
from bus import Bus, BusSettings, Publisher, QoS, clocks, open_bus
from schemas import codec
from schemas.detections import Box, ClassList, Detection, Mask
from schemas.keys import Stream
from schemas.worker_keys import WorkerAlive
from services.detector.model import DetectedObjects, Outcome, Request
from services.detector.process import DetectorWorker
from services.detector.worker_role import DETECTOR
from services.toolbox.process import run

PHASE_S: Final = 2.5
"""Time for which a pallet is in view, and out of it, by the machine's monotonic clock."""


SIDE: Final = 20
"""Pixels of the box: its cloud crosses the robot's link, beside the images."""


class Numbering(StandIn):
    """The stand-in model. run: tells this process from those before it."""

    name = "numbering"
    segments = True

    def __init__(self, run: str, frame_s: float) -> None:
        super().__init__(frame_s)
        self._names = (f"{MARK}{run}-{number}" for number in itertools.count())

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        await super().infer(batch)
        return [DetectedObjects(self._objects(request)) for request in batch]

    def _objects(self, request: Request) -> list[Detection]:
        height, width = request.frame.height, request.frame.width
        middle = Box((width - SIDE) / 2, (height - SIDE) / 2, (width + SIDE) / 2, (height + SIDE) / 2)
        mask = middle_mask(height, width) if request.masks else None
        found = [Detection(name="box", score=0.9, box=middle, mask=mask)]
        if int(time.monotonic() / PHASE_S) % 2:
            found.append(Detection(name=PALLET, score=0.8, box=middle))
        return [*found, Detection(name=next(self._names), score=0.7, box=middle)]


@lru_cache(8)
def middle_mask(height: int, width: int) -> Mask:
    """Return the mask of the box in the middle of an image."""
    pixels = np.zeros((height, width), np.uint8, order="F")
    pixels[height // 2 - SIDE // 2 :, width // 2 - SIDE // 2 :][:SIDE, :SIDE] = 1
    return Mask(size=(height, width), counts=coco.encode(pixels)["counts"].decode("ascii"))


class Noting:
    """A publisher of class lists that notes each in a journal once the bus has it."""

    def __init__(self, publisher: Publisher, journal: int) -> None:
        self._publisher = publisher
        self._journal = journal

    def __getattr__(self, name: str) -> Any:
        return getattr(self._publisher, name)

    def put(self, payload: bytes) -> None:
        """See `Publisher.put`."""
        self._publisher.put(payload)
        seen = codec.decode(ClassList, payload, codec.encoding(ClassList))
        names = {each.name for each in seen.classes}
        mark = next(name for name in names if name.startswith(MARK))
        line = Published(mark, seen.header.received_ns, pallet=PALLET in names).line()
        os.write(self._journal, line.encode("ascii"))


class NotingBus:
    """A bus whose publishers of class lists are `Noting`."""

    def __init__(self, bus: Bus, journal: int) -> None:
        self._bus = bus
        self._journal = journal

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)

    def publisher(self, key: str, qos: QoS, /, **options: Any) -> AbstractAsyncContextManager[Any]:
        """See `Bus.publisher`."""
        made = self._bus.publisher(key, qos, **options)
        return self._noted(made) if key.endswith(f"/{Stream.CLASSES}") else made

    @asynccontextmanager
    async def _noted(self, made: AbstractAsyncContextManager[Publisher]) -> AsyncIterator[Noting]:
        async with made as publisher:
            yield Noting(publisher, self._journal)


async def work(settings: BusSettings, name: str, journal: Path, frame_s: float) -> None:
    """Work until cancelled."""
    noted = os.open(journal, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    async with open_bus(settings) as bus:
        noting: Any = NotingBus(bus, noted)
        await DetectorWorker(noting, Numbering(name, frame_s), [WorkerAlive(DETECTOR.service, name)]).run()


if __name__ == "__main__":
    clocks.BOOT_ID = Path(sys.argv[5])
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    joined = BusSettings.model_validate_json(sys.argv[1])
    sys.exit(run(lambda: work(joined, sys.argv[2], Path(sys.argv[3]), float(sys.argv[4]) / 1e3)))
