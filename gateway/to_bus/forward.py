"""Forwards one topic while there is demand for its stream."""

import asyncio
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Final

from bus import Bus, Publisher
from bus.demand import SharedDemand, while_wanted
from gateway.ros1.tcpros.subscriber import LinkFailure, Message, Subscription
from gateway.ros1.wire.tcpros import ANY
from gateway.to_bus.shaping.stream_output import OutputCounts, OutputOf, StreamOutput, unshaped
from gateway.to_bus.stream import StreamForward
from gateway.to_bus.subscriptions import Latched, Subscriptions, latching
from schemas.header import MAX_LABEL
from schemas.status import StreamStatus

LINGER_S: Final = 2.0
"""Time for which a topic stays subscribed without demand.

Longer than one `rostopic echo -n 1` takes to follow another; short enough that a robot soon stops reading what nobody
looks at.
"""


@dataclass(slots=True)
class Forward:
    """A stream offered on the bus.

    subscription and latched: there while it is subscribed on ROS; their counts are added to the stream's afterwards.
    broken_before: what the subscription counted for others before it became the stream's too.
    """

    bus: Bus
    stream: StreamForward
    demand: SharedDemand
    publisher: Publisher
    output: StreamOutput
    output_of: OutputOf
    linger_s: float
    subscription: Subscription | None = None
    latched: Latched | None = None
    broken_before: Counter[str] = field(default_factory=Counter)

    def status(self) -> StreamStatus:
        """Return the counts of the stream's messages so far."""
        links = self.subscription.counters.links.values() if self.subscription else ()
        return self.stream.status(
            wanted=self.demand.wanted,
            publishers=sum(link.connected for link in links),
            replaced=self.publisher.counts.dropped + (self.latched.dropped if self.latched else 0),
            broken_links=self._broken(),
            output=self.output.counts + (self.latched.counts if self.latched else OutputCounts()),
            now_ns=time.time_ns(),
            problem="; ".join(self._problems())[:MAX_LABEL],
        )

    def retire(self) -> None:
        """Add the counts to the stream; call once, when it is no longer offered."""
        self.stream.retire(replaced=self.publisher.counts.dropped, broken_links={}, output=self.output.counts)

    def _broken(self) -> Counter[str]:
        return self._failures() - self.broken_before

    def _failures(self) -> Counter[str]:
        return Counter(self.subscription.counters.failures) if self.subscription else Counter()

    def _problems(self) -> list[str]:
        said = [self.stream.no_picture, self.latched.problem if self.latched else ""]
        return [*filter(None, said)] + [_with_cure(each) for each in self._connection_problems()]

    def _connection_problems(self) -> list[str]:
        return self.subscription.problems if self.subscription else []

    async def run(self, topics: Subscriptions) -> None:
        """Subscribe on ROS while the stream is wanted, or always if it merges messages; run forever."""
        if self.stream.kind.merges:
            await self._stay_subscribed(topics)
        else:
            await while_wanted(self.demand, lambda: self._subscribe(topics), linger_s=self.linger_s)

    async def _stay_subscribed(self, topics: Subscriptions) -> None:
        """Subscribe on ROS all the time, and anew when wanted after a pause, to forget publishers that left.

        A subscription made after a pause gets only the last message that a publisher latched in it.
        """
        while True:
            async with asyncio.TaskGroup() as group:
                subscribed = group.create_task(self._subscribe(topics))
                await self._wanted_after_a_pause()
                subscribed.cancel()

    async def _wanted_after_a_pause(self) -> None:
        paused_s = 0.0
        while paused_s < self.linger_s:
            await self.demand.until(wanted=False)
            since = time.monotonic()
            await self.demand.until(wanted=True)
            paused_s = time.monotonic() - since

    async def _subscribe(self, topics: Subscriptions) -> None:
        self.stream.begin()
        kind = self.stream.kind
        accepted = [name for name in kind.translators if name != ANY]
        try:
            async with latching(self.bus, self.stream.key, self.stream.topic, kind.encoding, self.output_of) as latched:
                self.latched = latched  # latched messages come while subscribing
                async with topics.subscribe(
                    self.stream.topic,
                    kind.ros_type,
                    self._on_message,
                    accepted=accepted,
                    on_gone=latched.forget,
                    on_unkept=latched.say_full,
                ) as self.subscription:
                    self.broken_before = self._failures()
                    await asyncio.Event().wait()
        finally:
            self._add_up()

    def _add_up(self) -> None:
        if self.latched:
            self.stream.retire(replaced=self.latched.dropped, broken_links=self._broken(), output=self.latched.counts)
        self.subscription = self.latched = None

    def _on_message(self, message: Message) -> None:
        latching, merges = message.publisher.latching, self.stream.kind.merges
        if not (self.publisher.wanted or latching or merges):
            self.stream.leave_out_unwanted(message)
            return
        translated = self.stream.take(message, time.time_ns())
        if translated is None:
            return
        latched = self.latched if latching and not merges else None
        if latched is None or not latched.put(message.uri, translated, len(message.data)):
            self.output.put(translated)


def _with_cure(problem: str) -> str:
    too_large = LinkFailure.TOO_LARGE in problem
    return f"{problem}; --max-message-mib lets larger ones through" if too_large else problem


@asynccontextmanager
async def offering(
    bus: Bus, stream: StreamForward, output_of: OutputOf = unshaped, *, linger_s: float = LINGER_S
) -> AsyncIterator[Forward]:
    """Offer a stream on the bus while the context lasts.

    output_of: what a publisher's messages go through. linger_s: how long the topic stays subscribed when nobody wants
        it any more.
    """
    demand = SharedDemand()
    stream.reset()
    key, kind = str(stream.key), stream.kind
    async with (
        bus.publisher(key, kind.qos, encoding=kind.encoding, on_demand=demand.of(key)) as publisher,
        bus.announce(stream.key.alive),
    ):
        with output_of(stream.key, publisher) as output:
            yield Forward(bus, stream, demand, publisher, output, output_of, linger_s)
