"""Messages as they come: an async iterator that says how many it had to leave out."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, aclosing, contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar
from weakref import WeakSet

from bus import BusClosedError, Subscription
from fleetsight.errors import ClosedError
from schemas import codec
from schemas.codec import M
from schemas.errors import SchemaError

CLOSE_TIMEOUT_S: Final = 2.0
"""How long it is waited for iterations that others are ending."""

T = TypeVar("T")


class Iterations:
    """Those that have begun and not ended. One that a `break` leaves behind is ended by a task of the event loop's."""

    def __init__(self) -> None:
        self._generators: WeakSet[AsyncGenerator[Any, None]] = WeakSet()
        self._unended: set[asyncio.Future[None]] = set()
        self._contexts: set[asyncio.Future[None]] = set()

    def add(self, generator: AsyncGenerator[T, None]) -> AsyncGenerator[T, None]:
        """Take note of an iteration, and return it."""
        self._generators.add(generator)
        return generator

    @contextmanager
    def running(self) -> Iterator[None]:
        """Say from within an iteration that it has begun, until it ends."""
        ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._unended.add(ended)
        try:
            yield
        finally:
            self._unended.discard(ended)
            ended.set_result(None)

    @contextmanager
    def context(self) -> Iterator[asyncio.Future[None]]:
        """Give a future that is done once this context has ended or the fleet is left, whichever comes first."""
        ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._contexts.add(ended)
        try:
            yield ended
        finally:
            self._contexts.discard(ended)
            _finish(ended)

    async def end(self) -> None:
        """End the contexts, and the iterations that wait for the program to go on."""
        for ended in self._contexts:
            _finish(ended)
        for generator in list(self._generators):
            with suppress(RuntimeError):  # another task waits in it, or ends it
                await generator.aclose()

    async def ended(self) -> None:
        """Wait until all have ended, once nothing more comes."""
        if self._unended:
            await asyncio.wait(self._unended, timeout=CLOSE_TIMEOUT_S)


def _finish(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)


Subscribe = Callable[[], AbstractAsyncContextManager[Subscription]]
Check = Callable[[str, M], None]
"""Holds a message to the key that it came under, and raises SchemaError where it speaks of another robot."""


@dataclass(frozen=True, slots=True)
class StreamCounts:
    """Messages of a stream since it was made.

    received: arrived here. dropped: of those, replaced by newer ones before the program took them. missed: never
    arrived, by their publishers' numbers. invalid: taken, but not what the contract says, and so left out.

    >>> fleetsight.StreamCounts(received=10, dropped=2)
    StreamCounts(received=10, dropped=2, missed=0, invalid=0)
    """

    received: int = 0
    dropped: int = 0
    missed: int = 0
    invalid: int = 0


class Stream(Generic[M]):
    """Messages of one kind, for as long as something iterates over them.

    Each `async for` subscribes when it begins and unsubscribes when it ends, by `break`, an error or cancellation. It
    ends by itself when the fleet is left. Memory is bounded: a program that is slow loses messages, the oldest first,
    and `counts` says how many.

    >>> async def main():
    ...     async with fleetsight.connect(endpoint) as fleet:
    ...         lists = fleet.class_lists(robot="r1")
    ...         async for seen in lists:
    ...             print([(each.name, each.count) for each in seen.classes])
    ...             break
    ...         print(lists.counts.dropped)
    >>> asyncio.run(main())
    [('box', 2)]
    0
    """

    def __init__(
        self, iterations: Iterations, what: str, schema: type[M], subscribe: Subscribe, check: Check[M]
    ) -> None:
        self._iterations = iterations
        self._what = what
        self._schema = schema
        self._subscribe = subscribe
        self._check = check
        self._ended = StreamCounts()
        self._running: set[Subscription] = set()
        self._invalid = 0

    @property
    def counts(self) -> StreamCounts:
        """The counts of received and lost messages so far, including those of iterations that have ended."""
        return self._with(*self._running)

    def _with(self, *subscriptions: Subscription) -> StreamCounts:
        received, dropped, missed = self._ended.received, self._ended.dropped, self._ended.missed
        for subscription in subscriptions:
            counts = subscription.counts
            received, dropped, missed = received + counts.received, dropped + counts.dropped, missed + counts.missed
        return StreamCounts(received, dropped, missed, self._invalid)

    def __aiter__(self) -> AsyncGenerator[M, None]:  # noqa: PYI058 - it can be closed
        """Iterate over the messages as they come.

        Raises:
            ClosedError: the fleet was left before.
        """
        return self._iterations.add(self._iterate())

    async def _iterate(self) -> AsyncGenerator[M, None]:
        with self._iterations.running():
            try:
                async with self._subscribe() as subscription, aclosing(self._taken(subscription)) as messages:
                    async for message in messages:
                        yield message
            except BusClosedError as error:
                raise ClosedError(f"{self._what}: the fleet was left before; iterate within `async with`") from error

    async def _taken(self, subscription: Subscription) -> AsyncGenerator[M, None]:
        self._running.add(subscription)
        try:
            async for sample in subscription:
                try:
                    message = codec.decode(self._schema, sample.payload, sample.encoding)
                    self._check(sample.key, message)
                except SchemaError:
                    self._invalid += 1
                else:
                    yield message
        finally:
            self._ended = self._with(subscription)
            self._running.discard(subscription)
