"""The reading ends, the same for the real bus and the fake: what arrives on any thread is taken on the event loop."""

import time
from asyncio import AbstractEventLoop
from collections.abc import AsyncIterator, Iterable
from typing import Final, Self, assert_never

from msgspec.structs import replace

from bus.api import Latest, Presence, Queue, Sample, SubscriptionCounts
from bus.delivery.inbox import Inbox
from bus.delivery.mailbox import Fifo, Mailbox, PerKey, Taken


def _mailbox(keep: Latest | Queue) -> Mailbox[str, Sample]:
    match keep:
        case Latest():
            return PerKey()
        case Queue(depth):
            return Fifo(depth)
        case never:
            assert_never(never)


class SampleReader:
    """A subscription's reading end."""

    def __init__(self, keep: Latest | Queue, loop: AbstractEventLoop) -> None:
        self._loop = loop
        self._inbox = Inbox(_mailbox(keep), loop)

    def arrive(self, key: str, payload: bytes, encoding: str, *, kept: bool = False) -> None:
        """Bring a sample. Any thread."""
        self.arrive_all([Sample(key, payload, encoding, time.time_ns(), kept=kept)])

    def arrive_all(self, samples: Iterable[Sample]) -> None:
        """Bring samples, in order. Any thread."""
        self._inbox.offer_all([(sample.key, sample) for sample in samples])

    def miss(self, number: int) -> None:
        """Count samples that will never arrive. Any thread."""
        self._inbox.miss(number)

    def end(self) -> None:
        """End the iteration."""
        self._inbox.end()

    @property
    def counts(self) -> SubscriptionCounts:
        """What became of the samples so far."""
        inbox = self._inbox
        return SubscriptionCounts(inbox.received, inbox.dropped, inbox.missed, inbox.unread)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Sample:
        return _sample(await self._inbox.take())

    async def batches(self, most: int) -> AsyncIterator[list[Sample]]:
        """Iterate over what is there at once."""
        async for first in self:
            yield [first, *map(_sample, self._inbox.take_waiting(most - 1))]


def _sample(taken: Taken[str, Sample]) -> Sample:
    return replace(taken.item, replaced=taken.dropped) if taken.dropped else taken.item


MAX_TOKENS: Final = 100_000
"""How many changes of presence wait: all of a large fleet come at once, and one that is dropped never comes again."""


class PresenceReader:
    """A watch's reading end. Remembers what it reported, so that doubled events are not reported twice."""

    def __init__(self, loop: AbstractEventLoop) -> None:
        self._inbox: Inbox[bool] = Inbox(PerKey(max_keys=MAX_TOKENS), loop)
        self._alive: set[str] = set()

    def arrive(self, key: str, *, alive: bool) -> None:
        """Bring a change. Any thread."""
        self._inbox.offer(key, alive)

    def end(self) -> None:
        """End the iteration."""
        self._inbox.end()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Presence:
        while True:
            taken = await self._inbox.take()
            if taken.item == (taken.key in self._alive):
                continue
            (self._alive.add if taken.item else self._alive.discard)(taken.key)
            return Presence(taken.key, taken.item)
