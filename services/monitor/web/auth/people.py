"""Users, and the sessions and tokens by which they are known. Pure."""

import hashlib
import re
import secrets
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from services.monitor.web.auth.visitor import Role

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
