"""Watches of presence tokens, and tokens of the real bus."""

from asyncio import AbstractEventLoop
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial

import zenoh

from bus.delivery.batching import taking
from bus.delivery.reading import PresenceReader
from bus.presence.listed_tokens import ListedTokens
from bus.presence.own_tokens import OwnTokens


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
        self._present: set[str] = set()
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
            for key in list(self._present):
                self.arrive(key, alive=False)
            self._present.clear()

    def _on_changes(self, samples: Sequence[zenoh.Sample]) -> None:
        for sample in samples:
            self.token(str(sample.key_expr), alive=sample.kind == zenoh.SampleKind.PUT)

    def token(self, key: str, *, alive: bool) -> None:
        """See `TokenReader`."""
        (self._present.add if alive else self._present.discard)(key)
        self.arrive(key, alive=alive)

    def all_listed(self) -> None:
        """See `TokenReader`."""


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
