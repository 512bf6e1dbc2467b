"""Stores users, sessions and tokens in the history's database, or in their own if no history is kept."""

import logging
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import asdict
from enum import StrEnum
from typing import Any, Final, TypeVar

from sqlalchemy import Row, delete, func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from services.monitor.history.engine import engine_of, translating
from services.monitor.history.opening import begin_alone, connect
from services.monitor.history.settings import NONE, default_state
from services.monitor.history.tables import logins, users
from services.monitor.web.auth.users import MAX_LOGINS, MAX_USERS, Kind, Login, Role, User

log = logging.getLogger(__name__)

E = TypeVar("E", bound=StrEnum)

MAX_LOADED: Final = MAX_USERS * MAX_LOGINS


def users_url(history: str) -> str:
    """Return the URL of the users' database for a history."""
    if history != NONE:
        return history
    return f"sqlite:///{default_state() / 'users.db'}"


class UserStore:
    """The users of a database. Every method raises HistoryError if it is unavailable.

    create: make it where there is none; one that was there once is waited for, a new one would let nobody in.
    left_out: the users that were there at the last reading and are of a newer version: their role is not known here.
    """

    def __init__(self, url: str, *, create: bool = True) -> None:
        self.left_out: set[str] = set()
        self._url = url
        self._create = create
        self._warned: set[str] = set()

    async def users(self) -> list[User]:
        """Return all users, by name."""
        async with self._connected() as connection:
            found, unknown = await self._users(connection)
        self._warn(unknown)
        return found

    async def load(self, now_ns: int) -> tuple[list[User], list[Login]]:
        """Return all users, and the valid sessions and tokens."""
        async with self._connected() as connection:
            query = logins.select().where(logins.c.until_ns > now_ns).order_by(logins.c.until_ns.desc())
            rows = (await connection.execute(query.limit(MAX_LOADED))).all()
            found, unknown = await self._users(connection)
        self._warn(unknown | {_unknown_kind(row) for row in rows if _member(Kind, row.kind) is None})
        return found, [login for row in rows if (login := _login(row)) is not None]

    async def add(self, user: User, *, first: bool = False) -> bool:
        """Add a user; return False if the name is taken or, for the first user, if there is any."""
        async with self._connected() as connection:
            await connection.run_sync(begin_alone)
            there = select(func.count()).select_from(users)
            count = await connection.scalar(there if first else there.where(users.c.name == user.name))
            if count:
                return False
            await connection.execute(users.insert().values(asdict(user)))
            await connection.commit()
        return True

    async def change(self, user: User) -> bool:
        """Change a user's password or role, and end their sessions and tokens; return False if the user is unknown."""
        async with self._connected() as connection:
            found = await connection.execute(users.update().where(users.c.name == user.name).values(asdict(user)))
            await connection.execute(delete(logins).where(logins.c.user == user.name))
            await connection.commit()
            return bool(found.rowcount)

    async def remove(self, name: str) -> bool:
        """Remove a user, and end their sessions and tokens; return False if there is no such user."""
        async with self._connected() as connection:
            found = await connection.execute(delete(users).where(users.c.name == name))
            await connection.execute(delete(logins).where(logins.c.user == name))
            await connection.commit()
            return bool(found.rowcount)

    async def keep(self, made: Iterable[Login], prolonged: Iterable[Login], ended: Iterable[str], now_ns: int) -> None:
        """Write new sessions and tokens and extended ends; delete ended ones."""
        async with self._connected() as connection:
            await connection.execute(delete(logins).where(logins.c.until_ns <= now_ns))
            rows = [asdict(login) for login in made]
            for digest in [*ended, *(row["digest"] for row in rows)]:  # the last write may have succeeded after all
                await connection.execute(delete(logins).where(logins.c.digest == digest))
            for login in prolonged:
                later = logins.update().where(logins.c.digest == login.digest)
                await connection.execute(later.values(until_ns=login.until_ns))
            if rows:
                await connection.execute(logins.insert(), rows)
            await connection.commit()

    async def _users(self, connection: AsyncConnection) -> tuple[list[User], set[str]]:
        """Return the users with known roles, and warnings about the others."""
        rows = (await connection.execute(users.select().order_by(users.c.name).limit(MAX_USERS))).all()
        others = [row for row in rows if _member(Role, row.role) is None]
        self.left_out = {row.name for row in others}
        return [user for row in rows if (user := _user(row)) is not None], {_unknown_role(row) for row in others}

    def _warn(self, unknown: set[str]) -> None:
        for each in sorted(unknown - self._warned):
            log.warning("left out: %s", each)
        self._warned = unknown

    @asynccontextmanager
    async def _connected(self) -> AsyncIterator[AsyncConnection]:
        async with translating():
            connection = await connect(engine_of(self._url), create=self._create)
            self._create = False
            try:
                yield connection
            finally:
                await connection.close()


def _user(row: Row[Any]) -> User | None:
    role = _member(Role, row.role)
    return None if role is None else User(row.name, role, row.password, row.changed_ns)


def _login(row: Row[Any]) -> Login | None:
    kind = _member(Kind, row.kind)
    return None if kind is None else Login(row.digest, row.user, kind, row.user_ns, row.until_ns)


def _member(of: type[E], value: str) -> E | None:
    return next((each for each in of if each == value), None)


def _unknown_role(row: Row[Any]) -> str:
    return f"the user {row.name!r}, whose role {row.role!r} this version does not know"


def _unknown_kind(row: Row[Any]) -> str:
    return f"log-ins of the kind {row.kind!r}, which this version does not know"
