"""The newest waiting frame of each camera, handed out fairly."""

import asyncio
import heapq
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

from schemas.image import ImageFrame
from schemas.keys import CameraKey


@dataclass(frozen=True, slots=True)
class QueuedFrame:
    """A frame, its arrival time in nanoseconds since the epoch, and its excess delay on the link by then."""

    frame: ImageFrame
    arrived_ns: int
    late_ns: int = 0

    def age_ns(self, now_ns: int, excused_ns: int = 0) -> int:
        """Return the frame's age: its delay on the link beyond the excused part, plus its waiting time."""
        return max(0, self.late_ns - excused_ns) + max(0, now_ns - self.arrived_ns)


class FrameQueue:
    """Holds at most one frame per camera; the camera served longest ago is next, so a fast camera starves no other."""

    def __init__(self) -> None:
        self._frames: dict[CameraKey, QueuedFrame] = {}
        self._served: dict[CameraKey, int] = {}
        self._turn = 0
        self._changed = asyncio.Event()

    def post(self, camera: CameraKey, waiting: QueuedFrame) -> int:
        """Queue a camera's newest frame; return the number of frames it replaced."""
        replaced = camera in self._frames
        self._frames[camera] = waiting
        self._changed.set()
        return int(replaced)

    def discard(self, camera: CameraKey) -> int:
        """Remove a camera; return the number of frames dropped with it."""
        self._served.pop(camera, None)
        return int(self._frames.pop(camera, None) is not None)

    def expire(self, now_ns: int, limit_ns: int, excused_ns: int = 0) -> list[CameraKey]:
        """Remove frames older than `limit_ns` (`QueuedFrame.age_ns`); return their cameras, which keep their turn."""
        expired = [camera for camera, waiting in self._frames.items() if waiting.age_ns(now_ns, excused_ns) > limit_ns]
        for camera in expired:
            del self._frames[camera]
        return expired

    def take(self, most: int) -> list[tuple[CameraKey, QueuedFrame]]:
        """Take at most this many frames, each of a different camera, those served longest ago first."""
        cameras = heapq.nsmallest(most, self._frames, key=lambda camera: self._served.get(camera, 0))
        self._turn += 1
        self._served.update(dict.fromkeys(cameras, self._turn))
        return [(camera, self._frames.pop(camera)) for camera in cameras]

    def by_turn(self, cameras: Iterable[CameraKey]) -> list[CameraKey]:
        """Return cameras in the order of their turns."""
        return sorted(cameras, key=lambda camera: self._served.get(camera, 0))

    async def filled(self, wished: int, patience_s: float) -> None:
        """Wait for a frame, then up to `patience_s` until the requested number of frames is queued."""
        await self._holds(1)
        if len(self._frames) < wished:
            with suppress(TimeoutError):
                async with asyncio.timeout(patience_s):
                    await self._holds(wished)

    async def _holds(self, count: int) -> None:
        while len(self._frames) < count:
            self._changed.clear()
            await self._changed.wait()
