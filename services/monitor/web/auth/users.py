"""Users, with their sessions and tokens."""

import hashlib
import re
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from starlette.requests import HTTPConnection

STATE: Final = "fleetsight.visitor"
"""The key of the visitor in a request's scope, set by the access middleware."""


class Role(StrEnum):
    """A user's role: read only, or act too."""

    VIEWER = "viewer"
    OPERATOR = "operator"


@dataclass(frozen=True, slots=True)
class Visitor:
    """A user who is logged in. Permissions are checked each time: roles change and sessions end meanwhile."""

    name: str
    _role: Callable[[], Role | None] = field(repr=False)
    _use: Callable[[], None] = field(repr=False, default=lambda: None)

    @property
    def role(self) -> Role | None:
        """The current role; None once the user is logged out or removed."""
        return self._role()

    def stay(self) -> None:
        """Extend the session without a request, as for a screen that shows everything by itself."""
        self._use()

    @property
    def may_look(self) -> bool:
        """Whether the visitor may still read."""
        return self.role is not None

    @property
    def may_act(self) -> bool:
        """Whether the visitor may act on alerts and robots."""
        return self.role is Role.OPERATOR


def visitor_of(request: HTTPConnection) -> Visitor:
    """Return the visitor of a request or WebSocket that the access middleware has passed."""
    visitor = request.scope[STATE]
    assert isinstance(visitor, Visitor), "only the middleware puts something there"  # noqa: S101 - for the type
    return visitor


USER_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+'@\-]{0,63}")
"""Allows e-mail addresses."""

MAX_USERS: Final = 1_000
MAX_LOGINS: Final = 100
"""Maximum number per user; the one that ends first is removed."""

TOKEN_BEGIN: Final = "fleetsight_"  # noqa: S105 - none
"""A prefix that identifies a token wherever it is found."""


class Kind(StrEnum):
    """The kind of a credential: a browser's session, or a program's token."""

    SESSION = "session"
    TOKEN = "token"  # noqa: S105 - none


@dataclass(frozen=True, slots=True)
class User:
    """A user. password: argon2 hash. changed_ns: the user's version."""

    name: str
    role: Role
    password: str
    changed_ns: int


@dataclass(frozen=True, slots=True)
class Login:
    """A session or token that is valid until then, or until its user is changed.

    digest: of what the browser or program shows, which itself is kept nowhere. user_ns: when its user was changed last.
    """

    digest: str
    user: str
    kind: Kind
    user_ns: int
    until_ns: int


def new_secret(kind: Kind) -> str:
    """Return a new secret for a browser or program."""
    return (TOKEN_BEGIN if kind is Kind.TOKEN else "") + secrets.token_urlsafe(32)


def digest_of(secret: str) -> str:
    """Return the stored digest of a secret; with 256 random bits it needs neither salt nor a slow hash."""
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def mistake_in_name(name: str) -> str:
    """Return why a user's name is refused, or nothing."""
    if USER_NAME.fullmatch(name):
        return ""
    return (
        "a user's name has 1 to 64 letters, digits and of _ - . + ' @, a letter or digit first, as in bob or "
        "bob@fleet.example"
    )
