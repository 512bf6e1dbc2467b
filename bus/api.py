"""The bus interface. `bus.open_bus` opens the real bus, `bus.fake.FakeNetwork` the one for tests."""

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from enum import Enum
from typing import Final, Protocol, Self

import msgspec

from bus.delivery.split_payload import Payload
from bus.session.link_use import LinkUse
from schemas import codec


class QoS(Enum):
    """Quality of service of a publisher. No message waits for a receiver."""

    IMAGE = "image"
    """Best effort, low priority, dropped under congestion; only the newest message waits."""
    MESSAGE = "message"
    """Dropped under congestion. Small ones, of up to SMALL_BYTES, wait in order until Zenoh takes them, at most
    SMALL_WAITING of them; they have the priority of STATUS, so they may overtake large ones. Zenoh drops what a
    link has no room for within a millisecond, and `dropped` does not count that: a burst of more than about 60 kB may
    lose some. A large one travels like IMAGE and replaces all that wait."""
    LATCHED = "latched"
    """Like IMAGE, but reliable, and the last one reaches late subscribers."""
    RESULT = "result"
    """Reliable, high priority; the last one reaches late subscribers and those whose link was cut."""
    STATUS = "status"
    """Like RESULT at normal priority."""


LATEST_BYTES: Final = 1 << 28
"""Of the newest samples of all keys of a subscription: twice the largest message."""


@dataclass(frozen=True, slots=True)
class Latest:
    """Keep the newest sample of each key, of LATEST_BYTES together; the key served longest ago is next.

    One that has no room beside those of other keys is dropped.
    """


QUEUE_BYTES: Final = 1 << 30
"""Of a queue that is given no limit: somebody who reads slowly, or not at all, does not fill the memory."""


@dataclass(frozen=True, slots=True)
class Queue:
    """Keep the `depth` newest samples in order of arrival (of one publisher: of sending), of `most_bytes` together.

    The newest is always kept.

    in_turn: in order for each robot (the first two parts of a key), and robots are served in turn. Without room, one
    that has about the most bytes loses its oldest: a flood of one robot's neither delays nor drops others'.
    """

    depth: int
    most_bytes: int = QUEUE_BYTES
    in_turn: bool = False

    def __post_init__(self) -> None:
        if self.depth < 1:
            raise ValueError(f"a queue depth must be at least 1, not {self.depth}")


LATEST: Final = Latest()
QUEUE: Final = Queue

SMALL_BYTES: Final = 64 << 10
"""Largest payload of MESSAGE that is queued; of larger ones only the newest waits."""

SMALL_WAITING: Final = 64
"""Most small payloads of MESSAGE that wait."""

DEFAULT_ENCODING: Final = "application/octet-stream"


class Sample(msgspec.Struct, frozen=True, gc=False):
    """A message as it arrived.

    `received_ns` is `time.time_ns()` at arrival in this process, or some milliseconds later where samples of many keys
    are fetched together, and each has a time of its own; one that waited for older ones of its publisher has an earlier
    time than those. `replaced` counts the samples of this key that were dropped here since the last one taken. `kept`
    tells that it is one that its publisher kept, so that it may have been sent long before.
    """

    key: str
    payload: bytes
    encoding: str
    received_ns: int
    replaced: int = 0
    kept: bool = False


@dataclass(frozen=True, slots=True)
class Presence:
    """A token appeared (`alive`) or vanished."""

    key: str
    alive: bool


@dataclass(frozen=True, slots=True)
class PublisherCounts:
    """Counts of messages put, and of those dropped in this process before the link took them."""

    put: int
    dropped: int


@dataclass(frozen=True, slots=True)
class SubscriptionCounts:
    """Counts of samples that arrived, and of those dropped in this process before they were taken.

    missed: those that never arrived, by the numbers of publishers of LATCHED, RESULT and STATUS. unread: those that
    arrived and of which whoever takes samples knows nothing: they wait, or went and were in no `replaced` yet.
    """

    received: int
    dropped: int
    missed: int = 0
    unread: int = 0


MAX_PAYLOAD_BYTES: Final = max(codec.MAX_BYTES.values())
"""Largest payload of a message: that of the largest image or cloud that is read."""

MAX_REQUEST_BYTES: Final = 16 * 1024 * 1024
"""Largest payload of a request, and of a reply. Those over 1 MiB may be lost on a slow or busy link."""

MAX_TIMEOUT_S: Final = 60.0
"""Longest timeout of a request."""


@dataclass(frozen=True, slots=True)
class Request:
    """A request as it arrived; `received_ns` is `time.time_ns()` at arrival in this process."""

    key: str
    payload: bytes
    encoding: str
    received_ns: int


@dataclass(frozen=True, slots=True)
class Reply:
    """A server's answer."""

    payload: bytes
    encoding: str = DEFAULT_ENCODING


Handler = Callable[[Request], Awaitable[Reply]]
"""Answers a request. RefusedError becomes an error that the caller sees with its text, any other one says no more than
"internal error" there and is logged here. Cancelled when the caller's time is up."""


class Publisher(Protocol):
    """Publishes on one key. Event loop only."""

    @property
    def wanted(self) -> bool:
        """Whether somebody, anywhere, subscribes to the key; False once closed."""

    @property
    def counts(self) -> PublisherCounts:
        """Counts of the messages so far."""

    def put(self, payload: Payload) -> None:
        """Queue a message for sending; it must not be changed afterwards.

        The message that finds a quick link slow may hold up its sender for some tens of milliseconds, once: the next
        ones, of any publisher, wait elsewhere until the link has been quick for a while.

        Raises:
            BusClosedError: the publisher or the bus is closed.
            BusError: the payload has more than MAX_PAYLOAD_BYTES, which no receiver takes.
            TypeError: the payload is neither bytes, bytearray nor Pieces.

        """


class Subscription(Protocol):
    """An endless iterator over samples; it ends when the subscription or the bus is closed."""

    @property
    def counts(self) -> SubscriptionCounts:
        """Counts of the samples so far."""

    def __aiter__(self) -> Self: ...

    async def __anext__(self) -> Sample:
        """Wait for the next sample.

        Raises:
            BusError: another task is waiting here already.

        """

    def batches(self, most: int) -> AsyncIterator[list[Sample]]:
        """Iterate over batches of up to `most` waiting samples, in order; cheaper per sample at high rates.

        Raises:
            BusError: another task is waiting here already.

        """


class Watch(Protocol):
    """An endless iterator over appearing and vanishing tokens, those already there first.

    Changes that nobody took yet are merged per key, so that a token is never reported alive, or gone, twice in a row.
    It ends when the watch or the bus is closed.
    """

    def __aiter__(self) -> Self: ...

    async def __anext__(self) -> Presence:
        """Wait for the next change.

        Raises:
            BusError: another task is waiting here already.

        """


class Bus(Protocol):
    """One process's connection to the bus. Event loop only.

    Entering a context declares, leaving it undeclares. While there is no link yet entering returns at once and the
    declaration is made when the link is there; links that break are rebuilt and declarations made again without
    anybody noticing here. Entering raises BusError for a bad key or a refused declaration, BusClosedError after close.
    """

    @property
    def link_problem(self) -> str:
        """Why the bus has no link, in words; empty while it has one or the settings name no endpoint to connect to."""

    @property
    def certificate(self) -> str:
        """The name under which routers with access rules know this process: its certificate's, or empty without one."""

    @property
    def links(self) -> LinkUse:
        """The number of links to other processes, incoming and outgoing, and its limit."""

    def publisher(
        self,
        key: str,
        qos: QoS,
        /,
        *,
        encoding: str = DEFAULT_ENCODING,
        kept: int = 1,
        on_demand: Callable[[bool], None] | None = None,
    ) -> AbstractAsyncContextManager[Publisher]:
        """Publish on one key until the context ends. `on_demand` is called on the event loop when `wanted` changes.

        kept: how many messages, the newest, are there for late subscribers and for those whose link was cut; or none.
        Leaving waits up to a second for what was put to be handed to the link.
        """

    def subscribe(
        self, key_expr: str, keep: Latest | Queue, /, *, history: bool = True, recover: int = 1, few: bool = False
    ) -> AbstractAsyncContextManager[Subscription]:
        """Subscribe to a key expression.

        With `history` the last LATCHED, RESULT or STATUS of each publisher comes first, also after a link was cut.
        Images have none: subscribe to them without, which costs the network less.

        recover: how many of each publisher come so, in order, as far as it kept them; with more than one, those
        lost on the way are asked for again too.
        few: so few publishers match that each sample is taken in as it comes; else those of a queue are fetched
        together, which takes a thread that wakes ten times a second.
        """

    def announce(self, key: str, /) -> AbstractAsyncContextManager[None]:
        """Declare a presence token under a key of this process alone, until the context or the process ends."""

    def watch(self, key_expr: str, /, *, few: bool = False) -> AbstractAsyncContextManager[Watch]:
        """Watch the presence tokens under a key expression. few: see `subscribe`."""

    def serve(
        self, key_expr: str, handler: Handler, /, *, at_once: int = 1, waiting: int = 16
    ) -> AbstractAsyncContextManager[None]:
        """Answer requests for the keys of an expression until the context ends, which cancels the handlers.

        At most `at_once` handlers run and `waiting` requests wait for one, the longest first; further requests are
        refused at once. A key that several members serve is answered by one of them; the other takes over when it goes.
        Entering raises BusError where this bus serves keys of the expression already.
        """

    async def request(
        self, key: str, payload: bytes | bytearray = b"", /, *, encoding: str = DEFAULT_ENCODING, timeout_s: float
    ) -> Reply:
        """Send a request to the server of a key. Late answers are ignored; a server drops expired requests.

        timeout_s: at most MAX_TIMEOUT_S.

        Raises:
            NotServedError: nobody serves the key, or whoever did went away before answering.
            RequestTimeoutError: no answer within `timeout_s`.
            RefusedError: the server's error.
            BusClosedError: the bus is, or was meanwhile, closed.
            BusError: a bad key, a payload over MAX_REQUEST_BYTES, too many requests unanswered.
            TypeError: the payload is neither bytes nor bytearray.

        """
