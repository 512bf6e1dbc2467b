"""Key expressions that a session declares to its peers under numeric ids, which are never freed.

A session has 65,535 ids. Zenoh (1.10) frees none and then starts over, although ids are still in use: messages
arrive under wrong keys from then on. So a repeated declaration uses its former id, except for the caches of
publishers: each takes a new one, and the session is renewed in time (see RENEWED_AFTER in bus.session.session).
"""

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Final

import zenoh

from bus.session.panics import panics_are_errors

MOST_KNOWN: Final = 20_000
"""Most keys of other processes that a session declares; messages under further keys arrive all the same."""

MOST_KEPT: Final = 20_000
"""Most keys of its own whose ids a session keeps."""

AT_ONCE: Final = 32
"""Keys declared in one turn of the session's thread."""

_log: Final = logging.getLogger(__name__)


def number_of(key_expr: str) -> str:
    """Return the key whose id a key expression uses: the chunks before its first wildcard."""
    return key_expr.partition("*")[0].rpartition("/")[0] if "*" in key_expr else key_expr


class KeyNumbers:
    """The numeric ids of a session's own keys, kept as long as the session."""

    def __init__(self) -> None:
        self._kept: dict[str, zenoh.KeyExpr] = {}

    def keep(self, session: zenoh.Session, key: str) -> None:
        """Reserve the id of a key that is about to be declared, so that undeclaring it does not lose it."""
        if key and key not in self._kept and len(self._kept) < MOST_KEPT:
            self._kept[key] = session.declare_keyexpr(key)

    def forget(self) -> None:
        """Forget all ids: the session has ended."""
        self._kept.clear()


class KnownKeys:
    """Keys that a client declares because they match its subscriptions.

    For each message under a key that is not declared, Zenoh (1.10) searches all keys that it knows: with
    5,000 robots that takes 0.8 ms, with their keys declared 18 µs.

    submit: queues a call on the session's thread.
    """

    number_of = ""
    takes_another = False

    def __init__(self, submit: Callable[[Callable[[], None]], object]) -> None:
        self._submit = submit
        self._session: zenoh.Session | None = None
        self._known: dict[str, zenoh.KeyExpr] = {}  # a key expression that is released is undeclared
        self._new: deque[str] = deque()
        self._going_on = False
        self._lock = threading.Lock()

    def declare(self, session: zenoh.Session) -> None:
        """Use this session from now on. Session's thread only."""
        self._session = session

    def undeclare(self) -> None:
        """Forget the session and its declared keys. Session's thread only."""
        self._session = None
        self._known.clear()

    def add(self, key: str) -> None:
        """Queue a key for declaration on the session. Any thread."""
        with self._lock:
            self._new.append(key)
            if self._going_on:
                return
            self._going_on = True
        self._submit(self._go_on)

    def _go_on(self) -> None:
        with self._lock:
            keys = [self._new.popleft() for _ in range(min(AT_ONCE, len(self._new)))]
            self._going_on = bool(keys)
        for key in keys:
            self._tell(key)
        if keys:
            self._submit(self._go_on)

    def _tell(self, key: str) -> None:
        if self._session is None or key in self._known or len(self._known) >= MOST_KNOWN:
            return
        try:
            with panics_are_errors():
                self._known[key] = self._session.declare_keyexpr(key)
        except Exception as error:  # noqa: BLE001 - what comes under it comes all the same
            _log.debug("%s was not declared: %s", key, error)
