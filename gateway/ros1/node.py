"""A ROS 1 node: one name at one master, with subscriptions and publications."""

from __future__ import annotations

import asyncio
import logging
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from random import Random
from typing import TYPE_CHECKING, Any, Self

from gateway.ros1.errors import Ros1Error
from gateway.ros1.master import MasterClient, SystemState
from gateway.ros1.messages import message_type
from gateway.ros1.names import resolve, validate_global, validate_type
from gateway.ros1.registrar import MasterState, Registrar
from gateway.ros1.registrations import Registration, Role
from gateway.ros1.slave import MasterCalls, SlaveApi
from gateway.ros1.stale_nodes import unregister_dead
from gateway.ros1.tasks import TaskScope, cancel_and_wait, to_the_end
from gateway.ros1.tcpros.publisher import Publication
from gateway.ros1.tcpros.server import TcprosServer
from gateway.ros1.tcpros.subscriber import Message, Subscription
from gateway.ros1.wire.tcpros import ANY, DEFAULT_MAX_MESSAGE_BYTES, Offer
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import XmlRpcServer

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, AsyncIterator, Callable, Collection, Mapping, Sequence
    from types import TracebackType

log = logging.getLogger(__name__)
NAME_TAKEN = "new node registered with same name"  # rosmaster's reason for ending the older of two nodes
MAX_CALL_BYTES = 256 << 10  # of a call of the slave API; the longest is a list of publishers


class Node:
    """A ROS node while its context lasts; the master may come and go. Leaving unregisters within a deadline.

    Leaving a subscription or a publication ends it here at once and waits for no master.

    Args:
        name: global. A master tells the older of two nodes of one name to end; this one then goes on as `{name}_2`.
        master_uri: where the master answers, such as `http://robot:11311`.
        host: the name or address under which others reach this node.
        poll_interval: seconds between looks at the master.
        timeout: seconds for each call, connection and handshake.
        exit_timeout: seconds for unregistering everything when the node is left.
        passive: tells of a node's name whether its subscriptions make none of the publications wanted.

    Raises:
        InvalidNameError: the name is not global and legal.

    """

    def __init__(
        self,
        name: str,
        *,
        master_uri: str,
        host: str = "127.0.0.1",
        poll_interval: float = 3.0,
        timeout: float = 5.0,
        exit_timeout: float = 1.0,
        passive: Callable[[str], bool] | None = None,
    ) -> None:
        self.shutdown_requested = asyncio.Event()
        self._timeout = timeout
        self._exit_timeout = exit_timeout
        self._passive = passive
        self._rng = Random()  # noqa: S311 - jitter, no secret
        self._client = XmlRpcClient(timeout=timeout)
        self.master = MasterClient(self._client, uri=master_uri, caller_id=validate_global(name))
        self.master_calls = MasterCalls(master_uri, self._client.resolver)
        self._scope = TaskScope()
        self._subscriptions: dict[str, Subscription] = {}
        self._publications: dict[str, Publication] = {}
        self._registrar = Registrar(master=self.master, lists=self, interval=poll_interval)
        self._slave = XmlRpcServer(
            SlaveApi(self), host=host, timeout=timeout, max_body_bytes=MAX_CALL_BYTES, check=self.master_calls.check
        )
        self._tcpros = TcprosServer(
            callerid=lambda: self.name, host=host, publications=self._publications, scope=self._scope, timeout=timeout
        )
        self._stack = AsyncExitStack()

    @property
    def name(self) -> str:
        """The node's name now."""
        return self.master.caller_id

    @property
    def uri(self) -> str:
        """The slave API's URI; known once entered."""
        return self._slave.uri

    @property
    def registered(self) -> bool:
        """Whether the master answers and has all of the node's registrations."""
        return self._registrar.settled

    @property
    def master_answers(self) -> bool | None:
        """Whether the master answered when it was last asked; None before that."""
        return self._registrar.master_answers

    async def looks(self) -> AsyncGenerator[MasterState, None]:
        """Yield the master's newest state after each regular look, without extra calls."""
        number = 0
        while True:
            look = await self._registrar.look_after(number)
            number = look.number
            yield look

    async def unregister_dead(self, name: str, state: SystemState) -> bool:
        """Unregister a dead node from the master; see `stale_nodes.unregister_dead`."""
        return await unregister_dead(name, state, client=self._client, master_uri=self.master_uri)

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            await stack.enter_async_context(self._client)
            await stack.enter_async_context(self._scope)
            await stack.enter_async_context(self._slave)
            await stack.enter_async_context(self._tcpros)
            registering = self._scope.start(self._registrar.run(self.uri), "registrar")
            stack.push_async_callback(lambda: to_the_end(self._unregister(registering)))
            self._stack = stack.pop_all()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self._stack.__aexit__(kind, error, traceback)

    async def _unregister(self, registering: asyncio.Task[None]) -> None:
        await cancel_and_wait({registering})
        with suppress(TimeoutError):
            async with asyncio.timeout(self._exit_timeout):
                await self._registrar.finish()

    @asynccontextmanager
    async def subscribe(
        self,
        topic: str,
        type_name: str,
        on_message: Callable[[Message], None],
        *,
        max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES,
        accepted: Collection[str] = (),
        on_gone: Callable[[str], None] | None = None,
    ) -> AsyncIterator[Subscription]:
        """Receive a topic as the master is told, of that type, or of the `accepted` ones, or of any for `*` alone.

        `on_message` is called on the event loop for every whole message and must not block. Its exceptions are logged
        and counted; `on_gone` is told the slave URI of each publisher that has gone for good. A node has one
        subscription of a topic at a time.

        Raises:
            InvalidNameError, UnknownTypeError: the topic or the type.
            Ros1Error: the topic is subscribed already.

        """
        topic = resolve(topic, self.name)
        if topic in self._subscriptions:
            raise Ros1Error(f"{self.name} subscribes to {topic} already")
        subscription = Subscription(
            callerid=lambda: self.name,
            topic=topic,
            expected=message_type(ANY if accepted else type_name).topic_type,
            on_message=on_message,
            client=self._client,
            scope=self._scope,
            rng=self._rng,
            timeout=self._timeout,
            max_message_bytes=max_message_bytes,
            accepted=[message_type(name).topic_type for name in accepted],
            on_gone=on_gone,
        )
        registration = Registration(Role.SUBSCRIBER, topic, type_name)
        self._subscriptions[topic] = subscription
        self._want(registration)
        try:
            yield subscription
        finally:
            del self._subscriptions[topic]
            links = subscription.close()
            self._registrar.release(registration)
            await cancel_and_wait(links)

    @asynccontextmanager
    async def advertise(
        self,
        topic: str,
        type_name: str,
        *,
        latch: bool = False,
        queue_size: int = 1,
        on_demand: Callable[[bool], None] | None = None,
    ) -> AsyncIterator[Publication]:
        """Publish a topic; at most `queue_size` messages wait for each subscriber, the newest win.

        `on_demand` is called on the event loop when the first subscriber comes and when the last one goes, until
        leaving.

        Raises:
            InvalidNameError, UnknownTypeError: the topic or the type; `*` cannot be advertised.
            Ros1Error: the topic is advertised already.

        """
        topic = resolve(topic, self.name)
        if topic in self._publications:
            raise Ros1Error(f"{self.name} publishes {topic} already")
        kind = message_type(validate_type(type_name))
        offer = Offer(topic, kind.topic_type, kind.definition, latch)
        publication = Publication(offer, queue_size=queue_size, on_demand=on_demand, passive=self._passive)
        registration = Registration(Role.PUBLISHER, topic, type_name)
        self._publications[topic] = publication
        self._want(registration)
        try:
            yield publication
        finally:
            del self._publications[topic]
            publication.close()
            self._registrar.release(registration)

    def _want(self, registration: Registration) -> None:
        if not self.shutdown_requested.is_set():
            self._registrar.want(registration)

    # The interfaces for the slave API and the registrar.

    @property
    def master_uri(self) -> str:
        return self.master.uri

    @property
    def tcpros_address(self) -> tuple[str, int]:
        return self._tcpros.address

    def publications(self) -> dict[str, str]:
        """Return message type names by topic."""
        return {topic: publication.offer.type.name for topic, publication in self._publications.items()}

    def subscriptions(self) -> dict[str, str]:
        """Return message type names by topic."""
        return {topic: subscription.type.name for topic, subscription in self._subscriptions.items()}

    def publishers_updated(self, topic: str, uris: Sequence[str]) -> None:
        """Set the publishers of a topic from the master's update."""
        if topic in self._subscriptions:
            self._subscriptions[topic].update_count += 1
            self.publishers_registered(topic, uris)

    def publishers_registered(self, topic: str, uris: Sequence[str]) -> None:
        """Set the publishers of a topic from the answer to a registration."""
        if topic in self._subscriptions:
            self._subscriptions[topic].publishers_updated(uris)

    def update_count(self, topic: str) -> int:
        """Return the number of publisherUpdate calls for the topic."""
        return self._subscriptions[topic].update_count if topic in self._subscriptions else 0

    def links(self) -> Mapping[str, Collection[bool]]:
        """Return by topic whether each listed publisher is connected."""
        return {topic: subscription.listed() for topic, subscription in self._subscriptions.items()}

    def shutdown(self, reason: str) -> None:
        """Release all registrations, for the owner of the node to end it, or take another name if this one was lost."""
        if NAME_TAKEN in reason:
            self._registrar.name_taken()
            return
        log.error("%s is asked to shut down: %s", self.name, reason)
        self._registrar.release_all()
        self.shutdown_requested.set()

    def bus_stats(self) -> list[Any]:
        """Return ROS's `[publish stats, subscribe stats, service stats]`."""
        return [
            [p.bus_stats() for p in self._publications.values()],
            [s.bus_stats() for s in self._subscriptions.values()],
            [],
        ]

    def bus_info(self) -> list[Any]:
        """Return ROS's list of `[id, destination, direction, transport, topic, connected]`."""
        outward = [row for publication in self._publications.values() for row in publication.bus_info()]
        return outward + [row for subscription in self._subscriptions.values() for row in subscription.bus_info()]
