"""What the bus offers; `bus.open_bus` gives the real one and `bus.fake.FakeNetwork` the one for tests."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from enum import Enum
from typing import Final, Protocol, Self


class QoS(Enum):
    """How a publisher's messages travel. None of them waits for a receiver."""

    IMAGE = "image"
    """Best effort, low priority, dropped under congestion; one waits at most, the newest."""
    RESULT = "result"
    """Reliable, high priority; the last one reaches late subscribers and those whose link was cut."""
    STATUS = "status"
    """Like RESULT at normal priority."""


@dataclass(frozen=True, slots=True)
class Latest:
    """Keep the newest sample of each key; the key served longest ago is next."""


@dataclass(frozen=True, slots=True)
class Queue:
    """Keep the `depth` newest samples in order of arrival (of one publisher: of sending)."""

    depth: int

    def __post_init__(self) -> None:
        if self.depth < 1:
            raise ValueError(f"a queue of {self.depth} holds nothing")


LATEST: Final = Latest()
QUEUE: Final = Queue

DEFAULT_ENCODING: Final = "application/octet-stream"


@dataclass(frozen=True, slots=True)
class Sample:
    """A message as it arrived.

    `received_ns` is `time.time_ns()` at arrival in this process; `replaced` counts the samples of this key that were
    dropped here since the last one taken.
    """

    key: str
    payload: bytes
    encoding: str
    received_ns: int
    replaced: int


@dataclass(frozen=True, slots=True)
class Presence:
    """A token appeared (`alive`) or vanished."""

    key: str
    alive: bool


@dataclass(frozen=True, slots=True)
class PublisherCounts:
    """Messages put, and those among them dropped here before the link took them."""

    put: int
    dropped: int


@dataclass(frozen=True, slots=True)
class SubscriptionCounts:
    """Samples that arrived, and those among them dropped here before they were taken."""

    received: int
    dropped: int


class Publisher(Protocol):
    """Publishes on one key. To be used on the event loop's thread."""

    @property
    def wanted(self) -> bool:
        """Whether somebody, anywhere, subscribes to the key; False once closed."""

    @property
    def counts(self) -> PublisherCounts:
        """What became of the messages so far."""

    def put(self, payload: bytes | bytearray) -> None:
        """Hand a message over to be sent; it must not be changed afterwards.

        The message that finds a quick link slow may hold up its sender for some tens of milliseconds, once: the next
        ones wait elsewhere until the link has been quick for a while.

        Raises:
            BusClosedError: the publisher or the bus is closed.
            TypeError: the payload is neither bytes nor bytearray.

        """


class Subscription(Protocol):
    """An endless iterator over samples; it ends when the subscription or the bus is closed."""

    @property
    def counts(self) -> SubscriptionCounts:
        """What became of the samples so far."""

    def __aiter__(self) -> Self: ...

    async def __anext__(self) -> Sample:
        """Wait for the next sample.

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
    """One process's place on the bus. To be used on the event loop's thread.

    Entering a context declares, leaving it undeclares. While there is no link yet entering returns at once and the
    declaration is made when the link is there; links that break are rebuilt and declarations made again without
    anybody noticing here. Entering raises BusError for a bad key or a refused declaration, BusClosedError after close.
    """

    def publisher(
        self,
        key: str,
        qos: QoS,
        /,
        *,
        encoding: str = DEFAULT_ENCODING,
        on_demand: Callable[[bool], None] | None = None,
    ) -> AbstractAsyncContextManager[Publisher]:
        """Publish on one key. `on_demand` is called on the event loop whenever `wanted` changes, until leaving.

        Leaving waits up to a second for what was put to be handed to the link.
        """

    def subscribe(
        self, key_expr: str, keep: Latest | Queue, /, *, history: bool = True
    ) -> AbstractAsyncContextManager[Subscription]:
        """Subscribe to a key expression.

        With `history` the last RESULT or STATUS of each publisher comes first, also after a link was cut. Images have
        none: subscribe to them without, which costs the network less.
        """

    def announce(self, key: str, /) -> AbstractAsyncContextManager[None]:
        """Be present under a key, which is this process's alone, until leaving or until the process is gone."""

    def watch(self, key_expr: str, /) -> AbstractAsyncContextManager[Watch]:
        """See who is present under a key expression."""
