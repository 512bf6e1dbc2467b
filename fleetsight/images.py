"""A camera's colour images; its gateway is told on which machine they are taken."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from bus import Bus, Latest, Queue, Subscription
from bus.clocks import clock_id
from schemas.consumer_keys import Wanted
from schemas.keys import CameraKey, Stream, StreamKey


@asynccontextmanager
async def images_of(bus: Bus, camera: CameraKey, keep: Latest | Queue) -> AsyncIterator[Subscription]:
    """Subscribe to the images. The gateway sends them raw to a program beside it, and as JPEG to others."""
    color = StreamKey(camera, Stream.COLOR)
    async with bus.announce(str(Wanted(color, clock_id()))), bus.subscribe(str(color), keep, history=False) as frames:
        yield frames
