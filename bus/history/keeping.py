"""The messages that publishers keep for subscribers that come late or lost their link, and the answers with them."""

import logging
import re
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from functools import partial
from random import getrandbits
from typing import Final

import zenoh
from zenoh.handlers import Callback

from bus.history.numbering import CACHE, cache_key, stamp
from bus.presence.own_tokens import OwnTokens
from bus.session.panics import panics_are_errors

MOST_KEPT: Final = (1 << 16) - 1
"""Most messages that a publisher can keep."""

RESUMED_S: Final = 30.0
"""Time after its end in which a publisher of the same key goes on with what the one before kept."""

_RANGE: Final = re.compile(r"(\d{0,18})\.\.(\d{0,18})")

_log: Final = logging.getLogger(__name__)


class KeptMessages:
    """The newest messages of one publisher, with their numbers, which go on over its sessions. Any thread."""

    def __init__(self, key: str, encoding: str, most: int) -> None:
        self.key = key
        self.encoding = encoding
        self.publisher = getrandbits(32)
        self._number = 0
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=min(most, MOST_KEPT))
        self._lock = threading.Lock()

    @property
    def most(self) -> int:
        """How many are kept."""
        return self._kept.maxlen or 0

    def add(self, payload: bytes) -> bytes:
        """Keep a message; return its attachment."""
        with self._lock:
            self._number += 1
            self._kept.append((self._number, payload))
            return stamp(self.publisher, self._number)

    def of(self, numbers: tuple[int, int | None], most: int | None) -> list[tuple[bytes, bytes]]:
        """Return the newest messages with numbers from the first to the second, each with its attachment."""
        first, last = numbers
        with self._lock:
            found = [each for each in self._kept if first <= each[0] and (last is None or each[0] <= last)]
        newest = found if most is None else found[max(0, len(found) - most) :]
        return [(payload, stamp(self.publisher, number)) for number, payload in newest]


class EndedPublishers:
    """Messages kept by this process's ended publishers, for the next publisher on the same key. One thread.

    A worker whose own link is lost stops serving all cameras until they are there again. Subscribers get the messages
    that it sent into that link from the next publisher, whose numbers go on.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._ended: OrderedDict[tuple[str, str, int], tuple[float, KeptMessages]] = OrderedDict()

    def messages(self, key: str, encoding: str, most: int) -> KeptMessages:
        """Return what a new publisher of a key keeps, of which there may be some already."""
        self._forget_old()
        _, found = self._ended.pop((key, encoding, min(most, MOST_KEPT)), (0.0, None))
        return found or KeptMessages(key, encoding, most)

    def add(self, kept: KeptMessages) -> None:
        """Note that a publisher has ended."""
        self._forget_old()
        if kept.most > 1:  # a newest message alone is worth something only while who sent it is there
            self._ended[kept.key, kept.encoding, kept.most] = self._clock(), kept

    def _forget_old(self) -> None:
        until_s = self._clock() - RESUMED_S
        while self._ended and next(iter(self._ended.values()))[0] < until_s:
            self._ended.popitem(last=False)


class CacheServer:
    """Answers queries for what the publishers of a session keep.

    prefix: the session's own one, under which all caches have one queryable; otherwise each has one. tokens: show that
    a cache is there. ended: for publishers, on the event loop's thread alone. All methods are called on the session's
    thread; queries are answered on Zenoh's, as by its own caches: one that waits for other work would not be answered
    in time.
    """

    number_of = ""
    takes_another = False

    def __init__(self, prefix: str, tokens: OwnTokens) -> None:
        self._prefix = prefix
        self._tokens = tokens
        self._lock = threading.Lock()
        self._session: zenoh.Session | None = None
        self.ended = EndedPublishers()
        self._queryables: dict[str, zenoh.Queryable[None]] = {}
        self._kept: dict[str, KeptMessages] = {}

    def declare(self, session: zenoh.Session) -> None:
        """Use this session from now on."""
        self._session = session
        if self._prefix:
            self._answer(session, f"{self._prefix}/**{CACHE}{session.zid()}/**")

    def undeclare(self) -> None:
        """Forget the session."""
        queryables, self._queryables = self._queryables, {}
        self._session = None
        with self._lock:
            self._kept.clear()
        for queryable in queryables.values():
            queryable.undeclare()

    def add(self, kept: KeptMessages) -> Callable[[], None]:
        """Answer queries for these until what is returned is called."""
        session = self._session
        if session is None:
            raise zenoh.ZError("the session has ended")
        cache = cache_key(kept.key, str(session.zid()), kept.publisher)
        if not self._has_one_for(cache):
            self._answer(session, cache)
        with self._lock:
            self._kept[cache] = kept
        # Before any live message where older ones are kept, too: subscribers ask for what is newer than they have.
        withdraw = self._tokens.show(cache, at_once=kept.most > 1)
        return partial(self._remove, cache, withdraw)

    def _remove(self, cache: str, withdraw: Callable[[], None]) -> None:
        withdraw()
        with self._lock:
            self._kept.pop(cache, None)
        if (queryable := self._queryables.pop(cache, None)) is not None:
            queryable.undeclare()

    def _has_one_for(self, cache: str) -> bool:
        return bool(self._prefix) and cache.startswith(f"{self._prefix}/")

    def _answer(self, session: zenoh.Session, key_expr: str) -> None:
        on_query = partial(self._on_query, zenoh.KeyExpr(key_expr))
        self._queryables[key_expr] = session.declare_queryable(key_expr, Callback(on_query, indirect=False))

    def _on_query(self, own: zenoh.KeyExpr, query: zenoh.Query) -> None:
        """Reply with what is asked for of one queryable, and finish the query."""
        try:
            with panics_are_errors():
                self._reply_all(own, query)
        except Exception as error:  # noqa: BLE001 - whoever asks, the others are answered
            _log.debug("a query for %s was not answered: %s", query.key_expr, error)
        finally:
            query.drop()

    def _reply_all(self, own: zenoh.KeyExpr, query: zenoh.Query) -> None:
        asked = query.key_expr
        numbers, most = _numbers(query.parameters.get("_sn")), _most(query.parameters.get("_max"))
        with self._lock:
            every = list(self._kept.items())
        for cache, kept in every:
            if own.intersects(cache) and asked.intersects(cache):
                for payload, attachment in kept.of(numbers, most):
                    query.reply(kept.key, payload, encoding=kept.encoding, attachment=attachment)


def _numbers(text: str | None) -> tuple[int, int | None]:
    """Return the first and the last number of Zenoh's range, such as `5..` or `5..9`; all of them if it is none."""
    found = _RANGE.fullmatch(text or "")
    if found is None:
        return 0, None
    return int(found[1] or 0), int(found[2]) if found[2] else None


def _most(text: str | None) -> int | None:
    return int(text) if text is not None and text.isascii() and text.isdigit() and len(text) < 10 else None
