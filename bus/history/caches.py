"""Messages that publishers keep: how they are numbered, and how many caches are asked at a time."""

import logging
import struct
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import Final

import zenoh
from zenoh.handlers import Callback

from bus.history.ordering import Fetch
from bus.session.panics import panics_are_errors

CACHE: Final = "/@adv/pub/"
"""In the key of an advanced publisher's cache and presence, between its own key and its session and number there."""

_STAMP: Final = struct.Struct(">BIQH")
_MARK: Final = 0xF5
"""What ours begin with."""

MOST_KEPT: Final = (1 << 16) - 1
"""As many as a publisher can keep."""


def stamp(publisher: int, number: int, newness: int) -> bytes:
    """Return what is attached to a message.

    publisher: one of 32 bits that tells it from others of its key. newness: 0 where the message is sent for the first
    time; else, of those that are sent again since there is a new session, 1 for the newest, 2 for the one before.
    """
    return _STAMP.pack(_MARK, publisher, number, newness)


def stamp_of(sample: zenoh.Sample) -> tuple[int | str, int, int] | None:
    """Return publisher, number and newness, as `stamp` has them, or None for one that nobody numbered.

    Other programs' have those of Zenoh.
    """
    attachment = sample.attachment
    if attachment is not None and len(attachment) == _STAMP.size:
        mark, publisher, number, newness = _STAMP.unpack(attachment.to_bytes())
        if mark == _MARK:
            return publisher, number, newness
    info = sample.source_info
    return None if info is None else (place_of(info.source_id), info.source_sn, 0)


def is_sent_again(sample: zenoh.Sample) -> bool:
    """Return whether a sample was sent on an earlier session of its publisher, too."""
    stamped = None if sample.attachment is None else stamp_of(sample)
    return stamped is not None and stamped[2] > 0


def place_of(publisher: zenoh.EntityGlobalId) -> str:
    """Return a publisher's session and number there, as caches' keys have them."""
    return f"{publisher.zid!s}/{publisher.eid}"


def owner_of(cache: str) -> tuple[str, str]:
    """Return the key whose messages a cache has, and the place of its publisher."""
    key, _, place = cache.rpartition(CACHE)
    return key, "/".join(place.split("/")[:2])


ASKED_AT_ONCE: Final = 16
TIMEOUT_S: Final = 2.0
"""Longest wait for one's answer: as long as links to who stands still count as whole, unless told otherwise."""

_log: Final = logging.getLogger(__name__)


class Caches:
    """The caches that one subscription asks.

    submit: has something done on the session's thread. recover: how many messages are wanted of each.
    answer: is given each message; answered: told that no more of them come, and whether any came.
    """

    def __init__(
        self,
        submit: Callable[[Callable[[], None]], object],
        recover: int,
        answer: Callable[[Fetch, zenoh.Sample], None],
        answered: Callable[[Fetch, bool], None],
    ) -> None:
        self._submit = submit
        self._recover = recover
        self._answer = answer
        self._answered = answered
        self._session: zenoh.Session | None = None
        self._turn = (
            0  # of asking; callbacks that held the session would let go of it at any time (see bus.session.session)
        )
        self._waiting: deque[Fetch] = deque()
        self._asked: set[str] = set()

    def use(self, session: zenoh.Session | None) -> None:
        """Ask on this session, or not at all; forget what was asked on another one. Session's thread only."""
        self._session = session
        self._turn += 1
        self._waiting.clear()
        self._asked.clear()

    def ask(self, fetch: Fetch) -> None:
        """Ask a cache when its turn comes."""
        self._submit(partial(self._enqueue, fetch))

    def _enqueue(self, fetch: Fetch) -> None:
        self._waiting.append(fetch)
        self._go_on()

    def _go_on(self) -> None:
        while self._session is not None and self._waiting and len(self._asked) < ASKED_AT_ONCE:
            self._send(self._session, self._waiting.popleft())

    def _send(self, session: zenoh.Session, fetch: Fetch) -> None:
        self._asked.add(fetch.cache)
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
        if turn == self._turn and reply.ok is not None and next(before) < self._recover:  # whatever it sends
            self._answer(fetch, reply.ok)

    def _done(self, turn: int, fetch: Fetch, replies: Iterator[int]) -> None:
        if turn == self._turn and fetch.cache in self._asked:  # an error may end it twice
            self._asked.discard(fetch.cache)
            self._answered(fetch, next(replies) > 0)
            self._go_on()


def _after(fetch: Fetch) -> str:
    """Return what leaves out of a cache's answer what came before, as Zenoh's caches (1.10) understand it."""
    _, place = owner_of(fetch.cache)
    taken = [info.source_sn for info in fetch.places if place_of(info.source_id) == place]
    return f"_sn={max(taken) + 1}..;" if taken else ""
