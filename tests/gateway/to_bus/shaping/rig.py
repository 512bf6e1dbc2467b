"""A robot's streams on a fake bus, shaped as a test says."""

import asyncio
from contextlib import AsyncExitStack

import msgspec

from bus import QUEUE, Presence, Subscription
from bus.fake import FakeNetwork
from gateway.to_bus.shaping.consumers import Consumers
from gateway.to_bus.shaping.settings import ShapingSettings
from gateway.to_bus.shaping.shaping import Shaping
from gateway.to_bus.shaping.stream_output import StreamOutput, unshaped
from gateway.to_bus.translators import kind_of
from schemas.consumer_keys import Wanted
from schemas.image import ImageFrame
from schemas.keys import SensorKey
from tests.gateway.to_bus.shaping.frames import frame, picture
from tests.schemas.frames import header


class Rig:
    """The streams of a robot on a fake bus."""

    def __init__(self, network: FakeNetwork, stack: AsyncExitStack) -> None:
        self.network = network
        self._stack = stack
        self.consumers = Consumers("r1", "here", near=True)

    async def shaping(self, **settings: object) -> Shaping:
        """Run the shaping of a gateway with such settings."""
        made = Shaping(ShapingSettings.model_validate(settings), self.consumers)
        bus = await self._stack.enter_async_context(self.network.open_bus())
        running = asyncio.create_task(made.run(bus))
        self._stack.push_async_callback(asyncio.wait, [running])
        self._stack.callback(running.cancel)
        return made

    async def output(self, key: SensorKey, shaping: Shaping | None = None) -> tuple[StreamOutput, Subscription]:
        """Open a stream's way, and see what arrives."""
        bus = await self._stack.enter_async_context(self.network.open_bus())
        kind = kind_of(key)
        publisher = await self._stack.enter_async_context(bus.publisher(str(key), kind.qos, encoding=kind.encoding))
        arrived = await self._stack.enter_async_context(bus.subscribe(str(key), QUEUE(999)))
        open_way = unshaped if shaping is None else shaping.output
        return self._stack.enter_context(open_way(key, publisher)), arrived

    def listens(self, key: SensorKey, clock: str, *, alive: bool = True) -> None:
        self.consumers.note(Presence(str(Wanted(key, clock, "w1")), alive))


def numbered(seq: int, size: int = 4) -> ImageFrame:
    return msgspec.structs.replace(frame("rgb8", picture(size, size)), header=header(seq=seq))
