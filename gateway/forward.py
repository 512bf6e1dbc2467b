"""Forward one topic while somebody wants its stream."""

import asyncio
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from bus import Bus, Publisher
from bus.shared_demand import SharedDemand, while_wanted
from gateway.ros1.node import Node
from gateway.ros1.subscriber import Message, Subscription
from gateway.stream import StreamForward
from schemas import codec
from schemas.status import StreamStatus


@dataclass(slots=True)
class Forward:
    """A stream that is offered on the bus.

    subscription: there while it is subscribed on ROS. broken_before: links that earlier subscriptions lost, by reason.
    """

    stream: StreamForward
    demand: SharedDemand
    publisher: Publisher
    subscription: Subscription | None = None
    broken_before: Counter[str] = field(default_factory=Counter)

    def status(self) -> StreamStatus:
        """Account for the stream's messages so far."""
        links = self.subscription.counters.links.values() if self.subscription else ()
        return self.stream.status(
            wanted=self.demand.wanted,
            publishers=sum(link.connected for link in links),
            replaced=self._replaced(),
            broken_links=self.broken_before + self._broken_now(),
        )

    def retire(self) -> None:
        """Hand the stream what was counted here; to be called once, when it is offered no longer."""
        self.stream.retire(replaced=self._replaced(), broken_links=self.broken_before + self._broken_now())

    def _replaced(self) -> int:
        return self.publisher.counts.dropped

    def _broken_now(self) -> Counter[str]:
        return Counter(self.subscription.counters.failures) if self.subscription else Counter()

    async def run(self, node: Node) -> None:
        """Subscribe on ROS whenever the stream is wanted, for ever."""
        await while_wanted(self.demand, lambda: self._subscribe(node))

    async def _subscribe(self, node: Node) -> None:
        self.stream.begin()
        async with node.subscribe(self.stream.topic, self.stream.kind.ros_type, self._on_message) as subscription:
            self.subscription = subscription
            try:
                await asyncio.Event().wait()
            finally:
                self.broken_before += self._broken_now()
                self.subscription = None

    def _on_message(self, message: Message) -> None:
        translated = self.stream.take(message, time.time_ns())
        if translated is not None:
            self.publisher.put(codec.encode(translated))


@asynccontextmanager
async def offering(bus: Bus, stream: StreamForward) -> AsyncIterator[Forward]:
    """Offer a stream on the bus for as long as the context lasts."""
    demand = SharedDemand()
    key, kind = str(stream.key), stream.kind
    async with (
        bus.publisher(key, kind.qos, encoding=kind.encoding, on_demand=demand.of(key)) as publisher,
        bus.announce(stream.key.alive),
    ):
        yield Forward(stream, demand, publisher)
