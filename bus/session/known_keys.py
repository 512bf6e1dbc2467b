"""Keys that a session tells the other end of its links, each by a number, once and for good.

A session has 65,535 numbers. Zenoh (1.10) gives back none and then begins anew, whatever still has its number: messages
come under the wrong keys from then on. So whatever is declared again has the number that it had, but for the caches of
publishers: each takes another one, which the next session makes up for (see RENEWED_AFTER in bus.session.session).
"""

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Final

import zenoh

from bus.session.panics import panics_are_errors

MOST_KNOWN: Final = 20_000
"""Keys of others that a session is told of; what comes under more of them comes all the same."""

MOST_KEPT: Final = 20_000
"""Keys of its own whose numbers a session keeps."""

AT_ONCE: Final = 32
"""Keys after which others get their turn on the session's thread."""

_log: Final = logging.getLogger(__name__)


def number_of(key_expr: str) -> str:
    """Return the key whose number a key expression takes: the chunks before its first wildcard."""
    return key_expr.partition("*")[0].rpartition("/")[0] if "*" in key_expr else key_expr


class Numbers:
    """The numbers of a session's own keys, kept as long as the session."""

    def __init__(self) -> None:
        self._kept: dict[str, zenoh.KeyExpr] = {}

    def keep(self, session: zenoh.Session, key: str) -> None:
        """Have a key that is about to be declared keep its number when it is undeclared."""
        if key and key not in self._kept and len(self._kept) < MOST_KEPT:
            self._kept[key] = session.declare_keyexpr(key)

    def forget(self) -> None:
        """The session is over."""
        self._kept.clear()


class KnownKeys:
    """Keys that match what a client subscribes to.

    For each message under a key that a client was not told of, Zenoh (1.10) looks through all keys that it knows: with
    5,000 robots that takes 0.8 ms, with their keys declared 18 µs.

    submit: has something done on the session's thread.
    """

    number_of = ""
    takes_another = False

    def __init__(self, submit: Callable[[Callable[[], None]], object]) -> None:
        self._submit = submit
        self._session: zenoh.Session | None = None
        self._known: dict[str, zenoh.KeyExpr] = {}  # one that is let go of is undeclared
        self._new: deque[str] = deque()
        self._going_on = False
        self._lock = threading.Lock()

    def declare(self, session: zenoh.Session) -> None:
        """Tell this session from now on. Session's thread only."""
        self._session = session

    def undeclare(self) -> None:
        """The session ends, and what it was told with it. Session's thread only."""
        self._session = None
        self._known.clear()

    def add(self, key: str) -> None:
        """Have the session told a key when there is time. Any thread."""
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
