"""Users, and the sessions and tokens by which they are known."""

import hashlib
import re
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from starlette.requests import HTTPConnection

STATE: Final = "fleetsight.visitor"
"""Where the access middleware puts the visitor in a request's scope."""


class Role(StrEnum):
    """What a user may do: look, or act too."""

    VIEWER = "viewer"
    OPERATOR = "operator"


@dataclass(frozen=True, slots=True)
class Visitor:
    """A user who is logged in. What they may do is asked anew each time: roles change and sessions end meanwhile."""

    name: str
    _role: Callable[[], Role | None] = field(repr=False)
    _use: Callable[[], None] = field(repr=False, default=lambda: None)

    @property
    def role(self) -> Role | None:
        """Their role now; None once they are logged out or no user any more."""
        return self._role()

    def stay(self) -> None:
        """Have their session go on though they ask for nothing, as before a screen that shows everything by itself."""
        self._use()

    @property
    def may_look(self) -> bool:
        """Whether they may still see anything."""
        return self.role is not None

    @property
    def may_act(self) -> bool:
        """Whether they may do something about alerts and robots."""
        return self.role is Role.OPERATOR


def visitor_of(request: HTTPConnection) -> Visitor:
    """Return who a request, or a WebSocket, comes from; to be used where the access middleware let it through."""
    visitor = request.scope[STATE]
    assert isinstance(visitor, Visitor), "only the middleware puts something there"  # noqa: S101 - for the type
    return visitor


USER_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+'@\-]{0,63}")
"""E-mail addresses are names too."""

MAX_USERS: Final = 1_000
MAX_LOGINS: Final = 100
"""Of one user; the one that ends first makes room."""

TOKEN_BEGIN: Final = "fleetsight_"  # noqa: S105 - none
"""So that whoever finds a token somewhere knows what it is for."""


class Kind(StrEnum):
    """What somebody is known by: a browser's session, or a program's token."""

    SESSION = "session"
    TOKEN = "token"  # noqa: S105 - none


@dataclass(frozen=True, slots=True)
class User:
    """Somebody who may log in. password: its argon2 hash. changed_ns: which version of them this is."""

    name: str
    role: Role
    password: str
    changed_ns: int


@dataclass(frozen=True, slots=True)
class Login:
    """A session or token that is good until then, or until its user is changed.

    digest: of what the browser or program shows, which itself is kept nowhere. user_ns: when its user was changed last.
    """

    digest: str
    user: str
    kind: Kind
    user_ns: int
    until_ns: int


def new_secret(kind: Kind) -> str:
    """Return what a browser or program is to show from now on."""
    return (TOKEN_BEGIN if kind is Kind.TOKEN else "") + secrets.token_urlsafe(32)


def digest_of(secret: str) -> str:
    """Return what is kept of a secret; one of 256 random bits needs neither salt nor slowness."""
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def mistake_in_name(name: str) -> str:
    """Return what is wrong with a user's name, or nothing."""
    if USER_NAME.fullmatch(name):
        return ""
    return (
        "a user's name has 1 to 64 letters, digits and of _ - . + ' @, a letter or digit first, as in bob or "
        "bob@fleet.example"
    )
