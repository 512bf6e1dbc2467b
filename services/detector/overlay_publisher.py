"""Publishes overlays: drawn in a thread, only while there are subscribers, and only the newest."""

import asyncio
import logging
from collections.abc import AsyncIterator, Mapping
from concurrent.futures import Executor
from contextlib import asynccontextmanager
from typing import Final

from bus import Publisher
from schemas import codec
from schemas.detections import Detections
from schemas.image import ImageFrame
from schemas.keys import Stream
from services.detector.overlay import overlays

log = logging.getLogger(__name__)

MASKS: Final = {Stream.OVERLAY_DETECTION: False, Stream.OVERLAY_SEGMENTATION: True}
"""All overlays, in drawing order, and whether they show masks."""


class Overlays:
    """The overlay streams of one camera. overlay_threads: threads that draw."""

    def __init__(self, publishers: Mapping[Stream, Publisher], overlay_threads: Executor | None) -> None:
        self._publishers = publishers
        self._overlay_threads = overlay_threads
        self._waiting: tuple[Detections, ImageFrame] | None = None
        self._offered = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()

    @property
    def wanted(self) -> bool:
        """Whether any overlay has a subscriber."""
        return any(publisher.wanted for publisher in self._publishers.values())

    @property
    def wants_masks(self) -> bool:
        """Whether an overlay with masks has a subscriber."""
        return any(publisher.wanted and MASKS[stream] for stream, publisher in self._publishers.items())

    def offer(self, found: Detections, frame: ImageFrame) -> None:
        """Queue a frame for drawing if there are subscribers; it replaces a queued one."""
        if self.wanted:
            self._waiting = (found, frame)
            self._offered.set()
            self._idle.clear()

    async def drawn(self) -> None:
        """Wait until every offered frame is published or dropped."""
        await self._idle.wait()

    async def run(self) -> None:
        """Draw and publish until cancelled."""
        while True:
            await self._offered.wait()
            self._offered.clear()
            taken, self._waiting = self._waiting, None
            if taken is not None:
                await self._draw(*taken)
            if self._waiting is None:
                self._idle.set()

    async def _draw(self, found: Detections, frame: ImageFrame) -> None:
        looked_at = [stream for stream in self._publishers if self._publishers[stream].wanted]
        drawn = map(codec.encode, overlays(found, frame, [MASKS[stream] for stream in looked_at]))
        for stream in looked_at:
            try:
                payload = await asyncio.get_running_loop().run_in_executor(self._overlay_threads, next, drawn)
            except Exception:  # one frame that cannot be drawn ends no camera
                header = frame.header
                log.exception("%s/%s: no %s of frame %d", header.robot, header.camera, stream, header.seq)
                return
            self._publishers[stream].put(payload)


@asynccontextmanager
async def drawing(
    publishers: Mapping[Stream, Publisher], overlay_threads: Executor | None = None
) -> AsyncIterator[Overlays]:
    """Draw offered frames while the context lasts.

    publishers: of the overlays that there can be, in the order they are drawn in. overlay_threads: see `Overlays`; the
    loop's own unless given.
    """
    made = Overlays(publishers, overlay_threads)
    async with asyncio.TaskGroup() as group:
        running = group.create_task(made.run())
        try:
            yield made
        finally:
            running.cancel()
