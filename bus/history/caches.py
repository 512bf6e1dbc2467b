"""Caches of kept messages: their numbering, and queries to a bounded number of them at a time."""

import logging
import struct
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import Final

import zenoh
from zenoh.handlers import Callback

from bus.history.key_state import Fetch
from bus.session.panics import panics_are_errors

CACHE: Final = "/@adv/pub/"
"""Separates an advanced publisher's key from its session and entity id in the key of its cache and presence."""

_STAMP: Final = struct.Struct(">BIQH")
_MARK: Final = 0xF5
"""First byte of our attachments."""

MOST_KEPT: Final = (1 << 16) - 1
"""Most messages that a publisher can keep."""


def stamp(publisher: int, number: int, newness: int) -> bytes:
    """Return the attachment that numbers a message.

    publisher: a 32-bit id, unique among those of its key. newness: 0 where the message is sent for the first
    time; for those sent again on a new session, 1 for the newest, 2 for the one before.
    """
    return _STAMP.pack(_MARK, publisher, number, newness)


def stamp_of(sample: zenoh.Sample) -> tuple[int | str, int, int] | None:
    """Return publisher, number and newness as in `stamp`, or None for a sample without a number.

    Messages of other programs have Zenoh's own numbers.
    """
    attachment = sample.attachment
    if attachment is not None and len(attachment) == _STAMP.size:
        mark, publisher, number, newness = _STAMP.unpack(attachment.to_bytes())
        if mark == _MARK:
            return publisher, number, newness
    info = sample.source_info
    return None if info is None else (place_of(info.source_id), info.source_sn, 0)


def is_sent_again(sample: zenoh.Sample) -> bool:
    """Return whether a sample was already sent on an earlier session of its publisher."""
    stamped = None if sample.attachment is None else stamp_of(sample)
    return stamped is not None and stamped[2] > 0


def place_of(publisher: zenoh.EntityGlobalId) -> str:
    """Return a publisher's session and entity id as they stand in the keys of caches."""
    return f"{publisher.zid!s}/{publisher.eid}"


def owner_of(cache: str) -> tuple[str, str]:
    """Return the key that a cache belongs to, and the place of its publisher."""
    key, _, place = cache.rpartition(CACHE)
    return key, "/".join(place.split("/")[:2])


ASKED_AT_ONCE: Final = 16
"""Caches that are asked at once, slow ones not counted."""

SLOW_S: Final = 0.25
"""A cache that has not answered after this counts as slow: the others do not wait for it."""

MOST_ASKED: Final = 256
"""Caches that are asked at once, slow ones counted."""

TIMEOUT_S: Final = 2.0
"""Longest wait for one cache: the default time for which a link to a stopped process counts as whole."""

_log: Final = logging.getLogger(__name__)


class Caches:
    """The caches that one subscription asks: those of each robot in turn, so that no robot's keep others' waiting.

    submit: queues a call on the session's thread; later: does so after a number of seconds. recover: the number of
    messages wanted from each. answer: receives each message; answered: is called at the end, with whether any came.
    """

    def __init__(
        self,
        submit: Callable[[Callable[[], None]], object],
        later: Callable[[float, Callable[[], None]], object],
        recover: int,
        answer: Callable[[Fetch, zenoh.Sample], None],
        answered: Callable[[Fetch, bool], None],
    ) -> None:
        self._submit = submit
        self._later = later
        self._recover = recover
        self._answer = answer
        self._answered = answered
        self._session: zenoh.Session | None = None
        # Callbacks compare the turn: one with a session would release that at any time (see bus.session.timing).
        self._turn = 0
        self._waiting: OrderedDict[str, deque[Fetch]] = OrderedDict()
        self._asked: dict[str, float] = {}
        self._looks_again = False

    def use(self, session: zenoh.Session | None) -> None:
        """Query on this session, or not at all with None; earlier queries are forgotten. Session's thread only."""
        self._session = session
        self._turn += 1
        self._waiting.clear()
        self._asked.clear()
        self._looks_again = False

    def ask(self, fetch: Fetch) -> None:
        """Query a cache when its turn comes."""
        self._submit(partial(self._enqueue, fetch))

    def _enqueue(self, fetch: Fetch) -> None:
        self._waiting.setdefault(_whose(fetch.key), deque()).append(fetch)
        self._go_on()

    def _go_on(self) -> None:
        while self._session is not None and self._waiting and self._may_ask:
            self._send(self._session, self._next())
        if self._session is not None and self._waiting and not self._looks_again:
            self._looks_again = True
            self._later(SLOW_S, partial(self._look_again, self._turn))

    def _next(self) -> Fetch:
        whose, fetches = self._waiting.popitem(last=False)
        fetch = fetches.popleft()
        if fetches:
            self._waiting[whose] = fetches
        return fetch

    @property
    def _may_ask(self) -> bool:
        if len(self._asked) < ASKED_AT_ONCE:
            return True
        slow_since_s = time.monotonic() - SLOW_S
        prompt = sum(asked_s > slow_since_s for asked_s in self._asked.values())
        return prompt < ASKED_AT_ONCE and len(self._asked) < MOST_ASKED

    def _look_again(self, turn: int) -> None:
        if turn == self._turn:
            self._looks_again = False
            self._go_on()

    def _send(self, session: zenoh.Session, fetch: Fetch) -> None:
        self._asked[fetch.cache] = time.monotonic()
        replies = count()
        done = partial(self._submit, partial(self._done, self._turn, fetch, replies))
        try:
            with panics_are_errors():
                session.get(
                    f"{fetch.cache}?{_after(fetch)}_max={self._recover}",
                    Callback(partial(self._on_reply, self._turn, fetch, replies), done, indirect=False),
                    accept_replies=zenoh.ReplyKeyExpr.ANY,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=TIMEOUT_S,
                )
        except Exception as error:  # noqa: BLE001 - whatever one cache meets, the others are asked
            _log.debug("%s was not asked: %s", fetch.cache, error)
            done()

    def _on_reply(self, turn: int, fetch: Fetch, before: Iterator[int], reply: zenoh.Reply) -> None:
        if turn == self._turn and reply.ok is not None and next(before) < self._recover:  # however many it sends
            self._answer(fetch, reply.ok)

    def _done(self, turn: int, fetch: Fetch, replies: Iterator[int]) -> None:
        if turn == self._turn and fetch.cache in self._asked:  # an error may end it twice
            del self._asked[fetch.cache]
            self._answered(fetch, next(replies) > 0)
            self._go_on()


def _whose(key: str) -> str:
    """Return the beginning of a key that says whose it is: `fleet/r1` of `fleet/r1/front/classes`."""
    return "/".join(key.split("/")[:2])


def _after(fetch: Fetch) -> str:
    """Return the query parameter by which Zenoh's caches (1.10) leave out messages that already came."""
    _, place = owner_of(fetch.cache)
    taken = [info.source_sn for info in fetch.places if place_of(info.source_id) == place]
    return f"_sn={max(taken) + 1}..;" if taken else ""
