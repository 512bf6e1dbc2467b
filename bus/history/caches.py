"""Queries for what publishers keep, to a bounded number of their caches at a time."""

import logging
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import Final

import zenoh
from zenoh.handlers import Callback

from bus.history.key_state import Fetch
from bus.history.numbering import is_of
from bus.keys import whose
from bus.session.panics import panics_are_errors

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
        self._waiting.setdefault(whose(fetch.key), deque()).append(fetch)
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


def _after(fetch: Fetch) -> str:
    """Return the query parameter by which caches leave out messages that already came, as Zenoh's (1.10) have it."""
    taken = [number for publisher, number in fetch.taken if is_of(fetch.cache, publisher)]
    return f"_sn={max(taken) + 1}..;" if taken else ""
