"""Blackens, scales and compresses frames off the event loop, one at a time."""

import asyncio
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from bus.delivery.mailbox import PerKey
from gateway.to_bus.shaping.compression import LOSSY, Frame, Method, compress
from gateway.to_bus.shaping.privacy import blackened
from gateway.to_bus.shaping.scaling import scale_image
from gateway.to_bus.shaping.uplink import Moment
from schemas import codec
from schemas.compression import JPEG, RAW
from schemas.image import Area, ImageFrame


@dataclass(frozen=True, slots=True)
class Shaped:
    """A shaped payload, its compression, and the moment of its job."""

    payload: bytes
    method: Method
    moment: Moment | None


@dataclass(frozen=True, slots=True)
class EncodeJob:
    """A frame, the work to do on it, and the moment that it shares with frames of other streams.

    private: areas of an image that are blackened.
    """

    frame: Frame
    factor: int
    method: Method
    moment: Moment | None = None
    private: tuple[Area, ...] = ()

    def do(self) -> Shaped:
        """Do the work; may take a while.

        Raises:
            ShapingError: the frame cannot be blackened or scaled.
        """
        frame, method = self.frame, self.method
        if self.private and isinstance(frame, ImageFrame):
            if frame.format == JPEG and method.format == RAW:
                method = LOSSY  # decoded for this alone, it would be many times as large
            frame = blackened(frame, self.private)
        if self.factor > 1 and isinstance(frame, ImageFrame):
            frame = scale_image(frame, self.factor)
        made, method = compress(frame, method)
        return Shaped(codec.encode(made), method, self.moment)


class EncoderClient(Hashable, Protocol):
    """A client of the encoder pool, called back on the event loop."""

    def shaped(self, made: Shaped) -> None:
        """Receive a frame's payload."""

    def on_error(self, error: Exception) -> None:
        """Receive the reason why a frame could not be shaped."""


class EncoderPool:
    """Keeps the newest waiting frame of each client, and serves clients in turn, each one's frames in order."""

    def __init__(self) -> None:
        self._jobs: PerKey[EncoderClient, EncodeJob] = PerKey()
        self._submitted = asyncio.Event()
        self._serving: EncoderClient | None = None

    def submit(self, client: EncoderClient, job: EncodeJob) -> int:
        """Queue a frame; return the number of frames it replaced."""
        self._submitted.set()
        return self._jobs.offer(client, job)

    def is_busy_for(self, client: EncoderClient) -> bool:
        """Return whether a frame of the client waits or is being shaped."""
        return client is self._serving or client in self._jobs

    def leave(self, client: EncoderClient) -> int:
        """Forget a client without further callbacks; return the number of its frames waiting or being shaped."""
        left = len(self._jobs.discard(client))
        if client is self._serving:
            self._serving = None
            left += 1
        return left

    async def run(self) -> None:
        """Shape frames, forever."""
        with _thread() as executor:
            while True:
                while (taken := self._jobs.take()) is None:
                    self._submitted.clear()
                    await self._submitted.wait()
                self._serving = taken.key
                await self._serve(taken.key, taken.item.do, executor)

    async def _serve(self, client: EncoderClient, do: Callable[[], Shaped], executor: Executor) -> None:
        made: Shaped | Exception
        try:
            made = await asyncio.get_running_loop().run_in_executor(executor, do)
        except Exception as error:  # noqa: BLE001 - whatever a frame does to an encoder, it fails alone
            made = error
        there, self._serving = self._serving, None
        if there is None:
            return
        if isinstance(made, Exception):
            client.on_error(made)
        else:
            client.shaped(made)


@contextmanager
def _thread() -> Iterator[Executor]:
    """Run the work in a thread of its own; leaving does not wait for a frame that is being shaped."""
    executor = ThreadPoolExecutor(1, thread_name_prefix="shaping")
    try:
        yield executor
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
