"""The presence tokens that a session shows."""

import logging
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Final

import zenoh

from bus.presence.token_lists import can_list, list_keys
from bus.session.declaration import reason_of

AGAIN_S: Final = 5.0
"""Delay before a list that was refused is tried again."""

TOGETHER_S: Final = 0.2
"""Shortest time between two changes of the lists: tokens that come and go in between make one change."""

_log: Final = logging.getLogger(__name__)


class OwnTokens:
    """Shows tokens: those under the session's prefix in lists, others as they are. Session's thread only.

    prefix: empty if the session has none. later: has a call made on the session's thread after some seconds.
    """

    number_of = ""
    takes_another = False

    def __init__(self, prefix: str, later: Callable[[float, Callable[[], None]], object]) -> None:
        self._prefix = prefix
        self._later = later
        self._session: zenoh.Session | None = None
        self._id = ""
        self._listed: Counter[str] = Counter()
        self._expected: list[str] = []
        self._lists: dict[str, zenoh.LivelinessToken] = {}
        self._shown: frozenset[str] = frozenset()
        self._changed_s = 0.0
        self._is_due = False

    def declare(self, session: zenoh.Session) -> None:
        """Show tokens on this session from now on.

        Tokens listed on the last session are expected to be shown again, and so are listed at once: subscribers know of
        publishers' caches before any message arrives. A cache's key has its session's id.
        """
        before, self._id = self._id, str(session.zid())
        self._expected = [key.replace(f"/{before}/", f"/{self._id}/") for key in self._listed]
        self._session = session
        self._listed = Counter()
        if self._expected:
            self._change()
            self._change_soon()

    def undeclare(self) -> None:
        """Forget the session; its tokens end with it."""
        self._session = None
        self._lists.clear()
        self._shown = frozenset()

    def show(self, key: str, *, at_once: bool = False) -> Callable[[], None]:
        """Show a token; return what withdraws it. at_once: also where that takes a list of its own for a moment.

        Raises:
            zenoh.ZError: it was refused.
        """
        if self._session is None:
            return lambda: None
        if not can_list(self._prefix, key):
            return self._session.liveliness().declare_token(key).undeclare
        self._listed[key] += 1
        if at_once and key not in self._shown:
            self._change()
        else:
            self._change_soon()
        return partial(self._withdraw, self._session, key)

    def _withdraw(self, session: zenoh.Session, key: str) -> None:
        if session is self._session:
            self._listed[key] -= 1
            self._listed += Counter()  # without those that are 0
            self._change_soon()

    def _change_soon(self) -> None:
        if not self._is_due:
            self._is_due = True
            self._later(max(0.0, self._changed_s + TOGETHER_S - time.monotonic()), self._change_now)

    def _change_now(self) -> None:
        self._is_due = False
        self._expected = []
        self._change()

    def _change(self) -> None:
        """Show the lists as they are now. New ones first, so that no token in both seems to vanish."""
        self._changed_s = time.monotonic()
        if self._session is None:
            return
        keys = sorted({*self._expected, *self._listed})
        wanted = set(list_keys(self._prefix, keys))
        gone = [token for key, token in self._lists.items() if key not in wanted]
        for key in wanted - self._lists.keys():
            try:
                self._lists[key] = self._session.liveliness().declare_token(key)
            except zenoh.ZError as error:
                _log.error("a list of presence tokens was refused: %s", reason_of(error))
                self._is_due = True
                self._later(AGAIN_S, self._change_now)
                return
        self._lists = {key: token for key, token in self._lists.items() if key in wanted}
        self._shown = frozenset(keys)
        for token in gone:
            token.undeclare()


class ZenohToken:
    """A presence token."""

    number_of = ""
    takes_another = False

    def __init__(self, key: str, tokens: OwnTokens) -> None:
        self._key = key
        self._tokens = tokens
        self._withdraw: Callable[[], None] | None = None

    def declare(self, _: zenoh.Session) -> None:
        """Declare on the session's thread."""
        self._withdraw = self._tokens.show(self._key)

    def undeclare(self) -> None:
        """Undeclare."""
        if self._withdraw is not None:
            self._withdraw()

    def end(self) -> None:
        """Do nothing: a presence has no reader."""
