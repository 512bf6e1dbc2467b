"""The newest waiting frame of each camera, handed out fairly."""

import asyncio
from dataclasses import dataclass

from bus.mailbox import PerKey
from schemas.image import ImageFrame
from schemas.keys import CameraKey


@dataclass(frozen=True, slots=True)
class Waiting:
    """A frame and when it arrived here, nanoseconds since the epoch."""

    frame: ImageFrame
    arrived_ns: int


class Board:
    """Holds at most one frame per camera; the camera served longest ago is next, so a fast one starves nobody."""

    def __init__(self) -> None:
        self._frames: PerKey[CameraKey, Waiting] = PerKey()
        self._filled = asyncio.Event()

    def post(self, camera: CameraKey, waiting: Waiting) -> int:
        """Put a camera's newest frame up; return how many frames it replaced."""
        self._filled.set()
        return self._frames.offer(camera, waiting)

    def discard(self, camera: CameraKey) -> int:
        """Take down what a camera has waiting; return how many frames that was."""
        return len(self._frames.discard(camera))

    async def take(self) -> tuple[CameraKey, Waiting]:
        """Wait for a frame and take it down."""
        while (taken := self._frames.take()) is None:
            self._filled.clear()
            await self._filled.wait()
        return taken.key, taken.item
