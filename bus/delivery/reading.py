"""Readers of the real bus and the fake: samples arrive on any thread and are taken on the event loop."""

import time
from asyncio import AbstractEventLoop
from collections.abc import AsyncIterator, Iterable
from typing import Final, Self, assert_never

from msgspec.structs import replace

from bus.api import LATEST_BYTES, Latest, Presence, Queue, Sample, SubscriptionCounts
from bus.delivery.inbox import Inbox
from bus.delivery.mailbox import Fifo, InTurn, Mailbox, PerKey, Taken
from bus.keys import whose

SAMPLE_BYTES: Final = 350
"""Bytes that a waiting sample takes beside its payload, with a key of its own."""


BYTES_AT_ONCE: Final = 4 << 20
"""Most bytes of a batch, but for its last sample: it is no part of what may wait."""


def _bytes_of(sample: Sample) -> int:
    return SAMPLE_BYTES + len(sample.payload)


def _mailbox(keep: Latest | Queue) -> Mailbox[str, Sample]:
    match keep:
        case Latest():
            return PerKey(most_bytes=LATEST_BYTES, size=_bytes_of)
        case Queue(depth, most_bytes, in_turn=False):
            return Fifo(depth, most_bytes, _bytes_of)
        case Queue(depth, most_bytes):
            return InTurn(depth, most_bytes, _bytes_of, whose)
        case never:
            assert_never(never)


class SampleReader:
    """The reader of a subscription."""

    def __init__(self, keep: Latest | Queue, loop: AbstractEventLoop) -> None:
        self._loop = loop
        self._inbox = Inbox(_mailbox(keep), loop)

    def arrive(self, key: str, payload: bytes, encoding: str, *, kept: bool = False) -> None:
        """Add a sample. Any thread."""
        self.arrive_all([Sample(key, payload, encoding, time.time_ns(), kept=kept)])

    def arrive_all(self, samples: Iterable[Sample]) -> None:
        """Add samples, in order. Any thread."""
        self._inbox.offer_all([(sample.key, sample) for sample in samples])

    def miss(self, number: int) -> None:
        """Count samples that are lost. Any thread."""
        self._inbox.miss(number)

    def end(self) -> None:
        """End the iteration."""
        self._inbox.end()

    @property
    def counts(self) -> SubscriptionCounts:
        """Counts of the samples so far."""
        inbox = self._inbox
        return SubscriptionCounts(inbox.received, inbox.dropped, inbox.missed, inbox.unread)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Sample:
        return _sample(await self._inbox.take())

    async def batches(self, most: int) -> AsyncIterator[list[Sample]]:
        """Iterate over batches of waiting samples."""
        async for first in self:
            left = BYTES_AT_ONCE - _bytes_of(first)
            yield [first, *map(_sample, self._inbox.take_waiting(most - 1, left, _bytes_of))]


def _sample(taken: Taken[str, Sample]) -> Sample:
    return replace(taken.item, replaced=taken.dropped) if taken.dropped else taken.item


MAX_TOKENS: Final = 100_000
"""Most changes of presence that wait: those of a large fleet come at once, and a dropped one is not repeated."""


class PresenceReader:
    """The reader of a watch. It reports duplicate events once."""

    def __init__(self, loop: AbstractEventLoop) -> None:
        self._inbox: Inbox[bool] = Inbox(PerKey(max_keys=MAX_TOKENS), loop)
        self._alive: set[str] = set()

    def arrive(self, key: str, *, alive: bool) -> None:
        """Add a change. Any thread."""
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
