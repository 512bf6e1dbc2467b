"""Overlays on their way out: drawn in a thread, while somebody looks, and the newest only."""

import asyncio
import logging
from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from functools import partial

from bus import Publisher
from schemas import codec
from schemas.detections import Detections
from schemas.image import ImageFrame
from services.detector.overlay import overlay

log = logging.getLogger(__name__)


class Overlay:
    """One overlay stream of one camera. painters: threads that draw."""

    def __init__(self, publisher: Publisher, painters: Executor | None, *, masks: bool) -> None:
        self._publisher = publisher
        self._painters = painters
        self._masks = masks
        self._waiting: tuple[Detections, ImageFrame] | None = None
        self._offered = asyncio.Event()

    @property
    def wanted(self) -> bool:
        """Whether somebody looks."""
        return self._publisher.wanted

    def offer(self, found: Detections, frame: ImageFrame) -> None:
        """Have this drawn next if somebody looks; what still waits for it is left out."""
        if self.wanted:
            self._waiting = (found, frame)
            self._offered.set()

    async def run(self) -> None:
        """Draw and publish until cancelled."""
        while True:
            await self._offered.wait()
            self._offered.clear()
            taken, self._waiting = self._waiting, None
            if taken is not None and self.wanted:
                await self._draw(*taken)

    async def _draw(self, found: Detections, frame: ImageFrame) -> None:
        try:
            draw = partial(_encoded, found, frame, masks=self._masks)
            drawn = await asyncio.get_running_loop().run_in_executor(self._painters, draw)
        except Exception:  # one frame that cannot be drawn ends no camera
            log.exception("%s/%s: no overlay of frame %d", frame.header.robot, frame.header.camera, frame.header.seq)
            return
        self._publisher.put(drawn)


def _encoded(found: Detections, frame: ImageFrame, *, masks: bool) -> bytes:
    return codec.encode(overlay(found, frame, masks=masks))


@asynccontextmanager
async def drawing(publisher: Publisher, painters: Executor | None = None, *, masks: bool) -> AsyncIterator[Overlay]:
    """Draw what is offered for as long as the context lasts. painters: see `Overlay`; the loop's own unless given."""
    made = Overlay(publisher, painters, masks=masks)
    async with asyncio.TaskGroup() as group:
        running = group.create_task(made.run())
        try:
            yield made
        finally:
            running.cancel()
