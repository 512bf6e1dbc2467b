"""Subscriptions of ROS topics, shared by streams that are made of the same topic."""

import asyncio
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Final

from bus import SMALL_BYTES, SMALL_WAITING, Bus, Publisher, QoS
from gateway.ros1.node import Node
from gateway.ros1.tasks import TaskScope
from gateway.ros1.tcpros.subscriber import Message, Subscription
from gateway.ros1.wire.tcpros import DEFAULT_MAX_MESSAGE_BYTES
from gateway.to_bus.shaping.stream_output import OutputCounts, OutputOf, StreamOutput
from schemas import codec
from schemas.keys import SensorKey
from schemas.status import ENDED

log = logging.getLogger(__name__)

MAX_PUBLISHERS: Final = 64
MAX_BYTES: Final = 64 << 20


def has_room(others: Collection[int], size: int) -> bool:
    """Return whether a message may be kept beside those of other publishers; sizes in bytes."""
    return len(others) < MAX_PUBLISHERS and sum(others) + size <= MAX_BYTES


@dataclass(slots=True, eq=False)
class _Kept:
    """The latched message of one ROS publisher.

    is_small: whether its messages are queued, rather than that the newest replaces those that wait. waiting: its last
    messages until there is a bus publisher, and an output to it.
    """

    is_small: bool
    size: int = 0
    waiting: deque[codec.Message] = field(default_factory=deque)
    publisher: Publisher | None = None
    output: StreamOutput | None = None
    closed: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def qos(self) -> QoS:
        """The quality of service of its messages."""
        return QoS.STATUS if self.is_small else QoS.LATCHED

    def wait(self, message: codec.Message) -> int:
        """Queue a message for the output; return the number of older ones dropped for it."""
        self.waiting.append(message)
        lost = max(0, len(self.waiting) - (SMALL_WAITING if self.is_small else 1))
        for _ in range(lost):
            self.waiting.popleft()
        return lost

    @property
    def dropped(self) -> int:
        """Messages replaced by newer ones between output and bus."""
        return self.publisher.counts.dropped if self.publisher else 0

    @property
    def counts(self) -> OutputCounts:
        """Counts of the messages in the output."""
        return self.output.counts if self.output else OutputCounts()


class Latched:
    """The last message of each latching publisher of a stream: at most MAX_PUBLISHERS and MAX_BYTES together.

    problem: in words, once a message could not be kept, or empty.
    """

    def __init__(
        self, bus: Bus, key: SensorKey, topic: str, encoding: str, output_of: OutputOf, *, scope: TaskScope
    ) -> None:
        self.problem = ""
        self._bus = bus
        self._key = key
        self._topic = topic
        self._encoding = encoding
        self._output_of = output_of
        self._scope = scope
        self._kept: dict[str, _Kept] = {}
        self._open: set[_Kept] = set()
        self._dropped = 0
        self._shaped = OutputCounts()

    @property
    def dropped(self) -> int:
        """Messages replaced by newer ones before the link took them."""
        return self._dropped + sum(kept.dropped for kept in self._open)

    @property
    def counts(self) -> OutputCounts:
        """Counts of the messages in all outputs."""
        return sum((kept.counts for kept in self._open), self._shaped)

    def put(self, publisher: str, message: codec.Message, size: int) -> bool:
        """Send a message and keep it instead of its publisher's last one; return False if there is no room.

        size: of the ROS message, in bytes.
        """
        if not self._has_room(publisher, size):
            self.forget(publisher)
            self.say_full(size)
            return False
        kept = self._place(publisher, is_small=size <= SMALL_BYTES)
        kept.size = size
        if kept.output is not None:
            kept.output.put(message, may_be_last=True)
        else:
            self._dropped += kept.wait(message)
        return True

    def _place(self, publisher: str, *, is_small: bool) -> _Kept:
        """Return a publisher's place: a new one if its messages now need another quality of service."""
        kept = self._kept.get(publisher)
        if kept is None or kept.is_small != is_small:
            self.forget(publisher)
            kept = self._kept[publisher] = _Kept(is_small)
            self._open.add(kept)
            self._scope.start(self._keep(kept), f"latched {self._key}")
        return kept

    def forget(self, publisher: str) -> None:
        """Forget a publisher and its message."""
        if kept := self._kept.pop(publisher, None):
            kept.closed.set()

    def say_full(self, size: int) -> None:
        """Log, the first time, that there is no room for a message. size: in bytes."""
        if not self.problem:
            self.problem = (
                f"a latched message of {size:,} bytes is not kept for late subscribers: at most {MAX_PUBLISHERS} "
                f"publishers' are, of {MAX_BYTES >> 20} MiB together"
            )
            log.warning("%s, %s: %s", self._key, self._topic, self.problem)

    def end(self) -> None:
        """Count messages that never reached the bus; call once nothing is kept any more."""
        for kept in list(self._open):
            self._add_up(kept)

    def _has_room(self, publisher: str, size: int) -> bool:
        return has_room([kept.size for name, kept in self._kept.items() if name != publisher], size)

    async def _keep(self, kept: _Kept) -> None:
        try:
            async with self._bus.publisher(str(self._key), kept.qos, encoding=self._encoding) as publisher:
                with self._output_of(self._key, publisher) as output:
                    kept.publisher, kept.output = publisher, output
                    while kept.waiting:
                        output.put(kept.waiting.popleft(), may_be_last=True)
                    await kept.closed.wait()
        finally:
            self._add_up(kept)

    def _add_up(self, kept: _Kept) -> None:
        self._open.discard(kept)
        self._dropped += kept.dropped
        self._shaped += kept.counts + OutputCounts({ENDED: len(kept.waiting)})


@asynccontextmanager
async def latching(bus: Bus, key: SensorKey, topic: str, encoding: str, output_of: OutputOf) -> AsyncIterator[Latched]:
    """Keep a stream's latched messages on the bus while the context lasts."""
    scope = TaskScope()
    latched = Latched(bus, key, topic, encoding, output_of, scope=scope)
    try:
        async with scope:
            yield latched
    finally:
        latched.end()


@dataclass(frozen=True, slots=True, eq=False)
class _Reader:
    """One user of a shared subscription. forget: called with the slave URI of a publisher that left for good."""

    take: Callable[[Message], None]
    forget: Callable[[str], None]


@dataclass(slots=True)
class _Shared:
    """A shared subscription. latched: the last messages of latching publishers, for later readers, while they fit.

    unkept: of what there was no room for, the size in bytes.
    """

    readers: list[_Reader] = field(default_factory=list)
    latched: dict[str, Message] = field(default_factory=dict)
    unkept: dict[str, int] = field(default_factory=dict)
    stack: AsyncExitStack = field(default_factory=AsyncExitStack)

    def on_message(self, message: Message) -> None:
        if message.publisher.latching:
            self._keep(message)
        for reader in list(self.readers):
            reader.take(message)

    def _keep(self, message: Message) -> None:
        self._forget(message.uri)
        if has_room([len(kept.data) for kept in self.latched.values()], len(message.data)):
            self.latched[message.uri] = message
        else:
            self.unkept[message.uri] = len(message.data)

    def _forget(self, uri: str) -> None:
        self.latched.pop(uri, None)
        self.unkept.pop(uri, None)

    def on_gone(self, uri: str) -> None:
        self._forget(uri)
        for reader in list(self.readers):
            reader.forget(uri)


class Subscriptions:
    """Subscribes a node to each topic once for all readers. max_message_bytes: longer messages are not read."""

    def __init__(self, node: Node, max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES) -> None:
        self._node = node
        self._max_message_bytes = max_message_bytes
        self._shared: dict[str, tuple[_Shared, Subscription]] = {}

    @asynccontextmanager
    async def subscribe(
        self,
        topic: str,
        type_name: str,
        on_message: Callable[[Message], None],
        *,
        accepted: Collection[str] = (),
        on_gone: Callable[[str], None],
        on_unkept: Callable[[int], None],
    ) -> AsyncIterator[Subscription]:
        """Receive a topic; see `Node.subscribe`. Readers of one topic must accept the same types.

        Messages that latching publishers sent before are taken first. on_unkept: told the size in bytes of each such
        message that is there no longer, since there was no room for it.
        """
        reader = _Reader(on_message, on_gone)
        if topic not in self._shared:
            shared = _Shared()
            entering = self._node.subscribe(
                topic,
                type_name,
                shared.on_message,
                max_message_bytes=self._max_message_bytes,
                accepted=accepted,
                on_gone=shared.on_gone,
            )
            self._shared[topic] = shared, await shared.stack.enter_async_context(entering)
        shared, subscription = self._shared[topic]
        shared.readers.append(reader)
        try:
            for message in list(shared.latched.values()):
                on_message(message)
            for size in shared.unkept.values():
                on_unkept(size)
            yield subscription
        finally:
            shared.readers.remove(reader)
            if not shared.readers:
                del self._shared[topic]
                await shared.stack.aclose()
