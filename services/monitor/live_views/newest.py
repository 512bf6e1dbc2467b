"""The newest message of a stream of pictures or clouds, for any number of people who look at it."""

import asyncio
from typing import Final, Generic, TypeVar

from bus import LATEST, Bus, Sample
from schemas import codec
from schemas.codec import Message
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.keys import Stream, StreamKey
from schemas.objects import ObjectClouds
from services.monitor.live_views.shared import Shared

MOST_STREAMS: Final = 64
"""How many different streams are looked at through one monitor at the same time."""

M = TypeVar("M", bound=Message)


class Newest(Generic[M]):
    """The newest message. number: how many came. received_ns: when it came. problem: why the last one was no good."""

    def __init__(self) -> None:
        self.message: M | None = None
        self.number = 0
        self.received_ns = 0
        self.problem = ""
        self._news = asyncio.Event()

    def take(self, message: M, received_ns: int) -> None:
        """Take a newer one; whoever waits is told."""
        self.message, self.received_ns, self.problem = message, received_ns, ""
        self.number += 1
        news, self._news = self._news, asyncio.Event()
        news.set()

    async def after(self, number: int) -> M:
        """Wait until more than `number` came; return the newest. Who is slow misses those in between."""
        while self.message is None or self.number <= number:
            await self._news.wait()
        return self.message


Pictures = Shared[StreamKey, Newest[ImageFrame]]
Clouds = Shared[StreamKey, Newest[ObjectClouds]]

OVERLAYS: Final = (Stream.OVERLAY_DETECTION, Stream.OVERLAY_SEGMENTATION)


def pictures(bus: Bus) -> Pictures:
    """Return the overlays that people look at; each is subscribed to, and so drawn, while at least one does."""
    return Shared(_nothing, lambda key, newest: follow(bus, key, ImageFrame, newest), MOST_STREAMS)


def clouds(bus: Bus) -> Clouds:
    """Return the object clouds that people look at; each is subscribed to, and so cut out, while at least one does."""
    return Shared(_nothing, lambda key, newest: follow(bus, key, ObjectClouds, newest), MOST_STREAMS)


def _nothing(_: StreamKey) -> Newest[M]:
    return Newest()


async def follow(bus: Bus, key: StreamKey, schema: type[M], newest: Newest[M]) -> None:
    """Subscribe to the stream until cancelled; what it is no good for is left out and said."""
    async with bus.subscribe(str(key), LATEST, history=False) as subscription:
        async for sample in subscription:
            try:
                newest.take(_read(sample, key, schema), sample.received_ns)
            except SchemaError as error:
                newest.problem = str(error)


def _read(sample: Sample, key: StreamKey, schema: type[M]) -> M:
    message = codec.decode(schema, sample.payload, sample.encoding)
    assert isinstance(message, ImageFrame | ObjectClouds)  # noqa: S101 - the two that are asked for
    codec.check_identity(message.header, key.camera)
    return message
