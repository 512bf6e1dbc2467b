"""Subscriptions of the real bus, without and with history."""

import sys
import threading
import time
from asyncio import AbstractEventLoop
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from bus.api import Latest, Queue, Sample
from bus.delivery.batching import DELIVERED_S, taking
from bus.delivery.inbox import call_soon
from bus.delivery.reading import SampleReader
from bus.history.caches import Caches
from bus.history.key_state import Fetch, Hold, Numbered
from bus.history.numbering import CACHE, is_sent_again, owner_of, stamp_of
from bus.history.ordering import History
from bus.presence.listed_tokens import ListedTokens
from bus.session.known_keys import number_of

AGAIN_S: Final = 0.5
"""Delay before an empty cache is asked again: Zenoh's routers (1.10) know their routes 0.1 s after a new link."""

HOLD_S: Final = 10.0
"""Longest time for which live messages of a key wait for older ones, whatever caches there seem to be."""

_PUT: Final = zenoh.SampleKind.PUT


class ZenohSubscription(SampleReader):
    """A subscription to messages published from now on. With many publishers, samples are fetched in batches."""

    takes_another = False

    def __init__(self, key_expr: str, keep: Latest | Queue, loop: AbstractEventLoop, *, few: bool) -> None:
        super().__init__(keep, loop)
        self._key_expr = key_expr
        self._together = isinstance(keep, Queue) and "*" in key_expr and not few
        self._most_bytes = keep.most_bytes if isinstance(keep, Queue) else sys.maxsize
        self._declared = ExitStack()
        self._turn = 0  # of being declared; callbacks compare it, as one with a session would release that at any time

    @property
    def number_of(self) -> str:
        """See `Declaration`."""
        return number_of(self._key_expr)

    def declare(self, session: zenoh.Session) -> None:
        """Declare on the session's thread."""
        declare = partial(session.declare_subscriber, self._key_expr)
        take = partial(self.take, self._turn)
        self._declared.enter_context(taking(declare, take, together=self._together, most_bytes=self._most_bytes))

    def undeclare(self) -> None:
        """Undeclare."""
        self._declared.close()

    def take(self, turn: int, samples: Sequence[zenoh.Sample]) -> None:  # noqa: ARG002 - for those with a history
        """Take live samples; those of an earlier declaration are ignored."""
        self.arrive_all(_sample(sample) for sample in samples if sample.kind == _PUT and not is_sent_again(sample))


class HistorySubscription(ZenohSubscription):
    """A subscription that also receives the messages publishers keep.

    Zenoh's own advanced subscriber (1.10) drops the history of those who send before it is there; it asks for what it
    missed under a key expression that has a router look through all its keys, once for each publisher that it waits
    for, and asks thousands of publishers at once.

    submit: queues a call on the session's thread. listed: tells of caches that are shown in lists. known: told the key
    of each that publishes.
    """

    def __init__(
        self,
        key_expr: str,
        keep: Latest | Queue,
        loop: AbstractEventLoop,
        submit: Callable[[Callable[[], None]], object],
        *,
        listed: ListedTokens,
        known: Callable[[str], None] | None,
        few: bool,
        recover: int,
    ) -> None:
        super().__init__(key_expr, keep, loop, few=few)
        self._submit = submit
        self._caches = Caches(submit, self._submit_later, recover, self._on_kept, self._on_fetched)
        self._history: History[Sample | None] = History(
            recover,
            self._caches.ask,
            self._ask_later,
            self._end_hold_later,
            self._deliver,
            self.miss,
            size=lambda sample: 0 if sample is None else len(sample.payload),
        )
        self._listed = listed
        self._unknown = 0  # kinds of tokens of which it is not known yet whether all have been told
        self._known = known
        self._one_at_a_time = threading.Lock()

    def declare(self, session: zenoh.Session) -> None:
        """Declare on the session's thread, presences first: live messages wait for kept ones of present publishers."""
        with self._one_at_a_time:
            self._turn += 1
            self._unknown = 2
            self._history.cut_off()
        self._caches.use(session)
        liveliness = session.liveliness()
        presences: Any = liveliness.declare_subscriber(
            self.tokens, Callback(partial(self._on_presence, self._turn), indirect=False)
        )
        self._declared.callback(presences.undeclare)
        done = partial(self._on_all_told, self._turn)
        liveliness.get(self.tokens, Callback(partial(self._on_present, self._turn), done, indirect=False))
        self._declared.callback(self._listed.add(self))
        super().declare(session)

    def undeclare(self) -> None:
        """Undeclare; held messages wait until it is known which publishers are still present."""
        self._caches.use(None)
        super().undeclare()

    def take(self, turn: int, samples: Sequence[zenoh.Sample]) -> None:
        """See `ZenohSubscription.take`."""
        numbered, others = _numbered(samples)
        self.arrive_all(others)
        with self._one_at_a_time:
            self._history.live(numbered, current=turn == self._turn)

    def _on_present(self, turn: int, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._on_presence(turn, reply.ok)

    def _on_presence(self, turn: int, presence: zenoh.Sample) -> None:
        self._take_token(turn, str(presence.key_expr), alive=presence.kind == _PUT)

    def _take_token(self, turn: int, cache: str, *, alive: bool) -> None:
        key, _ = owner_of(cache)
        with self._one_at_a_time:
            if turn != self._turn:
                return
            if alive:
                if self._known is not None:
                    self._known(key)
                self._history.appear(key, cache)
            else:
                self._history.leave(key, cache)

    @property
    def tokens(self) -> str:
        """See `TokenReader`: the tokens of caches."""
        return f"{self._key_expr}{CACHE}**"

    def token(self, key: str, *, alive: bool) -> None:
        """See `TokenReader`."""
        self._take_token(self._turn, key, alive=alive)

    def all_listed(self) -> None:
        """See `TokenReader`."""
        self._on_all_told(self._turn)

    def _on_all_told(self, turn: int) -> None:
        with self._one_at_a_time:
            if turn == self._turn:
                self._unknown -= 1
                if not self._unknown:
                    self._history.all_appeared()

    def _on_kept(self, fetch: Fetch, sample: zenoh.Sample) -> None:
        numbered, _ = _numbered([sample], kept=True)
        with self._one_at_a_time:
            for each in numbered:
                self._history.kept(fetch, each)

    def _on_fetched(self, fetch: Fetch, replied: bool) -> None:  # noqa: FBT001 - a callback's
        """Take a cache's answer; live messages that are still being fetched are taken before it."""
        fetched = partial(self._with_history, self._turn, partial(self._history.fetched, fetch, empty=not replied))
        if self._together:
            call_soon(self._loop, partial(self._loop.call_later, DELIVERED_S, fetched))
        else:
            fetched()

    def _ask_later(self, fetch: Fetch) -> None:
        self._call_later(AGAIN_S, partial(self._with_history, self._turn, partial(self._history.ask_again, fetch)))

    def _end_hold_later(self, hold: Hold) -> None:
        self._call_later(HOLD_S, partial(self._with_history, self._turn, partial(self._history.end_hold, hold)))

    def _submit_later(self, delay_s: float, call: Callable[[], None]) -> None:
        self._call_later(delay_s, partial(self._submit, call))

    def _call_later(self, delay_s: float, call: Callable[[], object]) -> None:
        call_soon(self._loop, partial(self._loop.call_later, delay_s, call))

    def _with_history(self, turn: int, act: Callable[[], None]) -> None:
        with self._one_at_a_time:
            if turn == self._turn:
                act()

    def _deliver(self, messages: list[Sample | None]) -> None:
        self.arrive_all(message for message in messages if message is not None)


def _numbered(
    samples: Iterable[zenoh.Sample], *, kept: bool = False
) -> tuple[list[Numbered[Sample | None]], list[Sample]]:
    """Return the numbered samples, deletions with None as message, and the samples without numbers.

    kept: they come from a cache; live ones that were sent again are left out.
    """
    numbered: list[Numbered[Sample | None]] = []
    others: list[Sample] = []
    for sample in samples:
        stamped = stamp_of(sample)
        if stamped is not None and stamped.again and not kept:
            continue
        message = _sample(sample, kept=kept) if sample.kind == _PUT else None
        if stamped is not None:
            key = str(sample.key_expr) if message is None else message.key
            numbered.append(Numbered(key, stamped.publisher, stamped.number, message))
        elif message is not None:
            others.append(message)
    return numbered, others


MOST_TEXTS: Final = 50_000
_texts: Final[dict[str, str]] = {}


def _once(text: str) -> str:
    """Return a text that many waiting samples share. Some Pythons (3.12) never free what `sys.intern` was given."""
    if len(_texts) >= MOST_TEXTS:
        _texts.clear()
    return _texts.setdefault(text, text)


def _sample(arrived: zenoh.Sample, *, kept: bool = False) -> Sample:
    """Return the sample with a reception time of its own, so that samples of one batch stay in order in time."""
    key, encoding = _once(str(arrived.key_expr)), _once(str(arrived.encoding))
    return Sample(key, arrived.payload.to_bytes(), encoding, time.time_ns(), kept=kept)
