"""Subscriptions of ROS topics that several streams are made of: a node has one of each topic."""

from collections.abc import AsyncIterator, Callable, Collection
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field

from gateway.latching import has_room
from gateway.ros1.node import Node
from gateway.ros1.subscriber import Message, Subscription
from gateway.ros1.wire.tcpros import DEFAULT_MAX_MESSAGE_BYTES


@dataclass(frozen=True, slots=True, eq=False)
class _Reader:
    """One of those who share. forget: told the slave URI of a publisher that has gone for good."""

    take: Callable[[Message], None]
    forget: Callable[[str], None]


@dataclass(slots=True)
class _Shared:
    """A topic's subscription. latched: what latching publishers sent last, while there is room, for later readers.

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
    """Subscribes a node to topics, once each, for as many as want them. max_message_bytes: longer ones are not read."""

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
        """Receive a topic; see `Node.subscribe`. Who shares a topic with another asks for the same types.

        What latching publishers sent before is taken first. on_unkept: told the size in bytes of each such message
        that is there no longer, since there was no room for it.
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
