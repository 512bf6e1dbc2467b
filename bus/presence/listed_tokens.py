"""Watches of presence tokens, and those tokens that others show in lists."""

import logging
import threading
from asyncio import AbstractEventLoop
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Final, Protocol

import zenoh
from zenoh.handlers import Callback

from bus.delivery.batching import taking
from bus.delivery.reading import PresenceReader
from bus.keys import is_single_key, whose
from bus.presence.token_lists import MOST_READ, FollowedTokens, listed_keys, lists_of

_PUT: Final = zenoh.SampleKind.PUT

ASK_AGAIN_S: Final = 5.0

_log: Final = logging.getLogger(__name__)


class TokenReader(Protocol):
    """Told of the tokens under a key expression, on any thread, never two at a time."""

    @property
    def tokens(self) -> str:
        """The key expression."""

    def token(self, key: str, *, alive: bool) -> None:
        """Take a change."""

    def all_listed(self) -> None:
        """Note that all tokens that were there have been told. Called again on each session."""


class ListedTokens:
    """Follows the lists that may hold what its readers watch, each kind of list once.

    prefix: the session's own, whose lists it leaves out: nobody else shows any there. later: has a call made on the
    session's thread after some seconds.
    """

    number_of = ""
    takes_another = False

    def __init__(self, prefix: str, later: Callable[[float, Callable[[], None]], object]) -> None:
        self._prefix = prefix
        self._later = later
        self._session: zenoh.Session | None = None
        self._followed: dict[str, _Lists] = {}

    def declare(self, session: zenoh.Session) -> None:
        """Use this session from now on. Session's thread only."""
        self._session = session

    def undeclare(self) -> None:
        """Forget the session. Session's thread only."""
        self._session = None
        followed, self._followed = self._followed, {}
        for lists in followed.values():
            lists.close()

    def add(self, reader: TokenReader) -> Callable[[], None]:
        """Tell a reader of listed tokens until what is returned is called. Session's thread only."""
        lists = lists_of(reader.tokens)
        if self._session is None or not lists or (self._prefix and lists.startswith(f"{self._prefix}/")):
            reader.all_listed()
            return lambda: None
        followed = self._followed.get(lists)
        if followed is None:
            followed = self._followed[lists] = _Lists(self._session, lists, self._later)
        followed.add(reader)
        return partial(self._remove, lists, followed, reader)

    def _remove(self, lists: str, followed: "_Lists", reader: TokenReader) -> None:
        followed.remove(reader)
        if followed.is_idle and self._followed.get(lists) is followed:
            del self._followed[lists]
            followed.close()


class ZenohWatch(PresenceReader):
    """A watch. Tokens are fetched in batches, since those of a large fleet appear at once.

    listed: tells of the tokens that are shown in lists.
    """

    number_of = ""
    takes_another = False

    def __init__(self, key_expr: str, loop: AbstractEventLoop, listed: ListedTokens, *, few: bool) -> None:
        super().__init__(loop)
        self.tokens = key_expr
        self._listed = listed
        self._few = few
        self._shown: set[str] = set()
        self._in_lists: set[str] = set()
        self._lock = threading.Lock()
        self._declared = ExitStack()

    def declare(self, session: zenoh.Session) -> None:
        """Declare on the session's thread."""
        declare = partial(session.liveliness().declare_subscriber, self.tokens, history=True)
        self._declared.enter_context(taking(declare, self._on_changes, together=not self._few))
        self._declared.callback(self._listed.add(self))

    def undeclare(self) -> None:
        """Undeclare and report all tokens as vanished: those that end before the next declaration go unnoticed."""
        try:
            self._declared.close()
        finally:
            with self._lock:
                gone = self._shown | self._in_lists
                self._shown.clear()
                self._in_lists.clear()
            for key in gone:
                self.arrive(key, alive=False)

    def _on_changes(self, samples: Sequence[zenoh.Sample]) -> None:
        for sample in samples:
            self._note(self._shown, str(sample.key_expr), alive=sample.kind == _PUT)

    def token(self, key: str, *, alive: bool) -> None:
        """See `TokenReader`."""
        self._note(self._in_lists, key, alive=alive)

    def all_listed(self) -> None:
        """See `TokenReader`."""

    def _note(self, kind: set[str], key: str, *, alive: bool) -> None:
        """Note a token that is shown, or is in lists; it is there as long as either."""
        with self._lock:
            (kind.add if alive else kind.discard)(key)
            self.arrive(key, alive=key in self._shown or key in self._in_lists)


class _Lists:
    """The lists under one key expression, on one session. later: see `ListedTokens`."""

    def __init__(
        self, session: zenoh.Session, lists: str, later: Callable[[float, Callable[[], None]], object]
    ) -> None:
        self._session: zenoh.Session | None = session
        self._expression = lists
        self._later = later
        self._lock = threading.Lock()
        self._readers: dict[TokenReader, zenoh.KeyExpr] = {}
        self._lists: dict[str, list[str]] = {}
        self._partly: set[str] = set()
        self._asks_again = False
        self._present = FollowedTokens()
        self._again = Counter[str]()  # in how many more lists a token is
        self._left_out = False
        self._all_told = False
        self._declared = ExitStack()
        declare = partial(session.liveliness().declare_subscriber, lists)
        self._declared.enter_context(taking(declare, self._on_lists, together="*/" in lists))
        session.liveliness().get(lists, Callback(self._on_list_there, self._on_all_there, indirect=False))

    @property
    def is_idle(self) -> bool:
        return not self._readers

    def close(self) -> None:
        self._declared.close()
        self._session = None

    def add(self, reader: TokenReader) -> None:
        expression = zenoh.KeyExpr(reader.tokens)
        with self._lock:
            self._readers[reader] = expression
            for key in self._present:
                if expression.intersects(key):
                    reader.token(key, alive=True)
            if self._all_told:
                reader.all_listed()

    def remove(self, reader: TokenReader) -> None:
        with self._lock:
            self._readers.pop(reader, None)

    def _on_list_there(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._on_lists([reply.ok])

    def _on_all_there(self) -> None:
        with self._lock:
            self._all_told = True
            for reader in list(self._readers):
                reader.all_listed()

    def _on_lists(self, samples: Sequence[zenoh.Sample]) -> None:
        with self._lock:
            for sample in samples:
                self._on_list(str(sample.key_expr), alive=sample.kind == _PUT)

    def _on_list(self, list_key: str, *, alive: bool) -> None:
        if alive == (list_key in self._lists) and not (alive and list_key in self._partly):
            return
        if len(list_key) > MOST_READ:
            _log.warning("left out: a list of %d characters of presence tokens: %s...", len(list_key), list_key[:80])
            return
        if not alive:
            self._partly.discard(list_key)
            for key in self._lists.pop(list_key):
                self._release(key)
            self._look_for_left_out()
        elif keys := self._take(list_key):
            self._lists.setdefault(list_key, []).extend(keys)

    def _release(self, key: str) -> None:
        if self._again[key] > 1:
            self._again[key] -= 1
        elif self._again.pop(key, 0) == 0:
            self._present.remove(key)
            self._tell(key, alive=False)

    def _look_for_left_out(self) -> None:
        """Ask for the lists again a while after there is room for what was left out."""
        if self._left_out and not self._asks_again and self._present.has_much_room:
            self._asks_again = True
            self._later(ASK_AGAIN_S, self._ask)

    def _ask(self) -> None:
        """Session's thread only."""
        with self._lock:
            self._asks_again = self._left_out = False
        if self._session is not None:
            done = Callback(self._on_list_there, lambda: None, indirect=False)
            self._session.liveliness().get(self._expression, done)

    def _take(self, list_key: str) -> list[str]:
        """Take the keys of a list for which there is room, and return them."""
        before = set(self._lists.get(list_key, ()))
        keys = list({key: None for key in listed_keys(list_key) if is_single_key(key) and key not in before})
        taken: list[str] = []
        for key in keys:
            if key in self._present:
                self._again[key] += 1
            elif self._present.add(key):
                self._tell(key, alive=True)
            else:
                continue
            taken.append(key)
        self._partly.discard(list_key)
        if len(taken) < len(keys):
            self._left_out |= self._present.is_full
            if taken or before:
                self._partly.add(list_key)
            _log.warning(
                "presence of %s is left out: its lists, or all, hold more tokens than are followed",
                whose(list_key)[:200],
            )
        return taken

    def _tell(self, key: str, *, alive: bool) -> None:
        for reader, expression in list(self._readers.items()):
            if expression.intersects(key):
                reader.token(key, alive=alive)
