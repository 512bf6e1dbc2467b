"""Subscription of one topic, with an independent link to each publisher that the master lists."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

from gateway.ros1.addresses import parse_offer
from gateway.ros1.errors import (
    FaultError,
    InvalidNameError,
    LinkRefusedError,
    Ros1Error,
    StatusError,
    TooLargeError,
    TypeMismatchError,
    UnreachableError,
)
from gateway.ros1.tcpros.link import run_link
from gateway.ros1.wire.framing import FrameBudget
from gateway.ros1.wire.header import MAX_HEADER_BYTES
from gateway.ros1.wire.tcpros import (
    DEFAULT_MAX_MESSAGE_BYTES,
    MessageReceived,
    PublisherAccepted,
    SubscriberConnection,
    SubscriberEvent,
    TopicType,
)
from gateway.ros1.wire.text import one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable
    from random import Random

    from gateway.ros1.tasks import TaskScope
    from gateway.ros1.xmlrpc.client import XmlRpcClient


class Backoff:
    """Doubles from `first` to `last` seconds, each delay jittered down by up to half."""

    def __init__(self, rng: Random, *, first: float = 0.1, last: float = 5.0) -> None:
        self._rng = rng
        self._first = first
        self._last = last
        self._next = first

    def reset(self) -> None:
        self._next = self._first

    def next_delay(self) -> float:
        """Return the next delay in seconds."""
        delay = self._next * self._rng.uniform(0.5, 1.0)
        self._next = min(self._next * 2, self._last)
        return delay


log = logging.getLogger(__name__)
MAX_PUBLISHERS = 256
_UNFINISHED_MESSAGES = 2  # of the largest size, of all publishers together


class LinkFailure(StrEnum):
    """Why a link to a publisher ended."""

    UNREACHABLE = "unreachable"
    REFUSED = "refused"
    MISMATCH = "type mismatch"
    TOO_LARGE = "message too large"
    PROTOCOL = "protocol error"
    CLOSED = "closed by the publisher"


class Message(NamedTuple):
    """One serialised message in a buffer of its own, and who sent it."""

    data: bytes | bytearray | memoryview
    uri: str
    publisher: PublisherAccepted

    @property
    def callerid(self) -> str:
        return self.publisher.callerid


@dataclass(slots=True)
class LinkCounters:
    """Counters of the link to one publisher; `problem` tells why it is not connected, after an attempt."""

    messages: int = 0
    bytes: int = 0
    connected: bool = False
    problem: str = ""
    failures: Counter[LinkFailure] = field(default_factory=Counter)


@dataclass(slots=True)
class SubscriptionCounters:
    """Counters of a subscription; `links` has the publishers listed or connected now, by slave URI."""

    callback_errors: int = 0
    failures: Counter[LinkFailure] = field(default_factory=Counter)
    links: dict[str, LinkCounters] = field(default_factory=dict)


class Subscription:
    """Keeps a link to every listed publisher; `on_message` sees every whole message, on the event loop.

    A link ends with its connection, not with the listing: a master that was restarted has forgotten publishers that are
    still there. `on_gone` is told the slave URI of a publisher that is neither listed nor connected any more.
    accepted: the types that a subscription to any takes; every one, when there are none. Publishers are then asked for
    any, since one that refuses us tells its own log, again and again, and us less than its header does.
    """

    def __init__(
        self,
        *,
        callerid: Callable[[], str],
        topic: str,
        expected: TopicType,
        on_message: Callable[[Message], None],
        client: XmlRpcClient,
        scope: TaskScope,
        rng: Random,
        timeout: float,
        max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES,
        accepted: Collection[TopicType] = (),
        on_gone: Callable[[str], None] | None = None,
    ) -> None:
        self.topic = topic
        self.counters = SubscriptionCounters()
        self.type = expected
        self._expected = expected
        self._accepted = accepted
        self._on_gone = on_gone
        self._max_message_bytes = max_message_bytes
        self._budget = FrameBudget(_UNFINISHED_MESSAGES * max(max_message_bytes, MAX_HEADER_BYTES))
        self._callerid = callerid
        self._on_message = on_message
        self._client = client
        self._scope = scope
        self._rng = rng
        self._timeout = timeout
        self.update_count = 0
        self._listed: set[str] = set()
        self._links: dict[str, asyncio.Task[None]] = {}

    @property
    def problems(self) -> list[str]:
        """Why publishers are not connected, in words; reachable ones that do not fit come first."""
        failing = [(uri, link) for uri, link in self.counters.links.items() if link.problem]
        failing.sort(key=lambda item: item[1].problem.startswith(LinkFailure.UNREACHABLE))
        return [one_line(f"{uri}: {link.problem}") for uri, link in failing]

    def listed(self) -> list[bool]:
        """Return whether each listed publisher is connected."""
        return [link.connected for uri, link in self.counters.links.items() if uri in self._listed]

    def publishers_updated(self, uris: Iterable[str]) -> None:
        """Follow the master's list: link to new publishers, drop those neither listed nor connected."""
        listed = dict.fromkeys(uris)
        self._listed = set(listed)
        for uri in self._links.keys() - listed:
            if not self.counters.links[uri].connected:
                self._forget(uri).cancel()
        for uri in [uri for uri in listed if uri not in self._links]:
            if len(self._links) >= MAX_PUBLISHERS:
                log.warning("%s: more than %d publishers, the rest is ignored", self.topic, MAX_PUBLISHERS)
                return
            self.counters.links[uri] = LinkCounters()
            self._links[uri] = self._scope.start(self._keep_link(uri), f"{self.topic} from {uri}")

    def close(self) -> set[asyncio.Task[None]]:
        """Drop every link; return the tasks that are ending."""
        self._on_gone = None
        tasks = {self._forget(uri) for uri in list(self._links)}
        for task in tasks:
            task.cancel()
        return tasks

    def _forget(self, uri: str) -> asyncio.Task[None]:
        del self.counters.links[uri]
        if self._on_gone is not None:
            self._on_gone(uri)
        return self._links.pop(uri)

    def bus_stats(self) -> list[Any]:
        """Return `[topic, [[id, bytes, messages, drop estimate, connected]...]]`."""
        links = enumerate(self.counters.links.values())
        return [
            self.topic,
            [[i, link.bytes, link.messages, -1, link.connected] for i, link in links],
        ]

    def bus_info(self) -> list[Any]:
        """Return `[id, publisher, direction, transport, topic, connected]` of each link."""
        links = enumerate(self.counters.links.items())
        return [[i, uri, "i", "TCPROS", self.topic, link.connected] for i, (uri, link) in links]

    async def _keep_link(self, uri: str) -> None:
        counters = self.counters.links[uri]
        backoff = Backoff(self._rng)
        while True:
            before = counters.messages
            failure, reason = await self._run_link(uri, counters)
            counters.connected = False
            if uri not in self._listed:
                self._forget(uri)
                return
            if counters.messages > before:
                backoff.reset()
            counters.problem = f"{failure}: {reason}"
            counters.failures[failure] += 1
            self.counters.failures[failure] += 1
            level = logging.WARNING if counters.failures[failure] == 1 else logging.DEBUG
            log.log(level, "%s as publisher of %s: %s: %s", uri, self.topic, failure, reason)
            await asyncio.sleep(backoff.next_delay())

    async def _run_link(self, uri: str, counters: LinkCounters) -> tuple[LinkFailure, str]:
        """Return why the link ended."""
        try:
            address = await self._request_topic(uri)
            connection = SubscriberConnection(
                callerid=self._callerid(),
                topic=self.topic,
                expected=self._expected,
                max_message_bytes=self._max_message_bytes,
                budget=self._budget,
            )
            sink = _Sink(self, uri, counters)
            await run_link(address, connection, sink, resolver=self._client.resolver, handshake_timeout=self._timeout)
        except Ros1Error as error:
            return _failure_of(error), str(error)
        return LinkFailure.CLOSED, "end of stream"

    async def _request_topic(self, uri: str) -> tuple[str, int]:
        return parse_offer(await self._client.call(uri, "requestTopic", self._callerid(), self.topic, [["TCPROS"]]))

    def accept(self, found: TopicType) -> None:
        """Accept a publisher's type, or raise.

        Raises:
            TypeMismatchError: it is none of the accepted ones.

        """
        if self._accepted and found not in self._accepted:
            namesakes = [f"[{each.md5sum}]" for each in self._accepted if each.name == found.name]
            expected = " or ".join(namesakes or [each.name for each in self._accepted])
            raise TypeMismatchError(
                f"{self.topic} is {one_line(found.name)} [{one_line(found.md5sum)}], expected {expected}"
            )
        self.type = found

    def deliver(self, message: Message) -> None:
        """Pass on a message."""
        try:
            self._on_message(message)
        except Exception:  # the link survives any exception of the caller's code
            self.counters.callback_errors += 1
            if self.counters.callback_errors == 1:
                log.exception("%s from %s: the callback failed", self.topic, message.uri)


class _Sink:
    """Turns one connection's events into the subscription's messages."""

    def __init__(self, subscription: Subscription, uri: str, counters: LinkCounters) -> None:
        self._subscription = subscription
        self._uri = uri
        self._counters = counters
        self._publisher: PublisherAccepted | None = None

    def __call__(self, event: SubscriberEvent) -> None:
        match event:
            case MessageReceived(data) if self._publisher is not None:
                self._counters.messages += 1
                self._counters.bytes += len(data)
                self._subscription.deliver(Message(data, self._uri, self._publisher))
            case PublisherAccepted():
                self._subscription.accept(event.type)
                self._publisher = event
                self._counters.connected = True
                self._counters.problem = ""


def _failure_of(error: Ros1Error) -> LinkFailure:
    match error:
        case TypeMismatchError():
            return LinkFailure.MISMATCH
        case LinkRefusedError() | FaultError() | StatusError():
            return LinkFailure.REFUSED
        case UnreachableError() | InvalidNameError():
            return LinkFailure.UNREACHABLE
        case TooLargeError():
            return LinkFailure.TOO_LARGE
        case _:
            return LinkFailure.PROTOCOL
