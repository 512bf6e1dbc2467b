"""Users, sessions and tokens in the database of the history, or in one of their own where no history is kept."""

import asyncio
import dataclasses
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

from sqlalchemy import delete, func, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection

from services.monitor.history.engine import engine_of, file_of, private_file, translating
from services.monitor.history.settings import NONE
from services.monitor.history.tables import logins, metadata, users
from services.monitor.web.auth.people import MAX_LOGINS, MAX_USERS, Kind, Login, User
from services.monitor.web.auth.visitor import Role

MAX_LOADED: Final = MAX_USERS * MAX_LOGINS


def users_url(history: str) -> str:
    """Return the database of the users where history is kept there."""
    if history != NONE:
        return history
    return f"sqlite:///{Path('~/.local/state/fleetsight/users.db').expanduser()}"


class UserStore:
    """The users of a database. Every method raises HistoryError when it cannot be had."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._made = False

    async def users(self) -> list[User]:
        """Return everybody, by name."""
        async with self._connected() as connection:
            return await _users(connection)

    async def load(self, now_ns: int) -> tuple[list[User], list[Login]]:
        """Return everybody, and the sessions and tokens that are good now."""
        async with self._connected() as connection:
            query = logins.select().where(logins.c.until_ns > now_ns).order_by(logins.c.until_ns.desc())
            rows = (await connection.execute(query.limit(MAX_LOADED))).all()
            found = [Login(row.digest, row.user, Kind(row.kind), row.user_ns, row.until_ns) for row in rows]
            return await _users(connection), found

    async def add(self, user: User, *, first: bool = False) -> bool:
        """Add somebody; return False if the name is taken or, for the first one, anybody is there."""
        async with self._connected() as connection:
            there = select(func.count()).select_from(users)
            count = await connection.scalar(there if first else there.where(users.c.name == user.name))
            if count:
                return False
            try:
                await connection.execute(users.insert().values(_row_of(user)))
                await connection.commit()
            except IntegrityError:
                return False
        return True

    async def change(self, user: User) -> bool:
        """Give somebody another password or role, and end their sessions and tokens; return False if nobody is it."""
        async with self._connected() as connection:
            found = await connection.execute(users.update().where(users.c.name == user.name).values(_row_of(user)))
            await connection.execute(delete(logins).where(logins.c.user == user.name))
            await connection.commit()
            return bool(found.rowcount)

    async def remove(self, name: str) -> bool:
        """Remove somebody, and end their sessions and tokens; return False if nobody is it."""
        async with self._connected() as connection:
            found = await connection.execute(delete(users).where(users.c.name == name))
            await connection.execute(delete(logins).where(logins.c.user == name))
            await connection.commit()
            return bool(found.rowcount)

    async def keep(self, made: Iterable[Login], prolonged: Iterable[Login], ended: Iterable[str], now_ns: int) -> None:
        """Write new sessions and tokens and later ends of those that are there; forget those that ended."""
        async with self._connected() as connection:
            await connection.execute(delete(logins).where(logins.c.until_ns <= now_ns))
            rows = [_row_of(login) for login in made]
            for digest in [*ended, *(row["digest"] for row in rows)]:  # the last write may have been done after all
                await connection.execute(delete(logins).where(logins.c.digest == digest))
            for login in prolonged:
                later = logins.update().where(logins.c.digest == login.digest)
                await connection.execute(later.values(until_ns=login.until_ns))
            if rows:
                await connection.execute(logins.insert(), rows)
            await connection.commit()

    @asynccontextmanager
    async def _connected(self) -> AsyncIterator[AsyncConnection]:
        async with translating():
            engine = engine_of(self._url)
            file = file_of(engine)
            try:
                if file is not None:
                    await asyncio.to_thread(private_file, file)
                async with engine.connect() as connection:
                    if not self._made:
                        await connection.run_sync(metadata.create_all)
                        await connection.commit()
                        self._made = True
                    yield connection
            finally:
                await engine.dispose()


async def _users(connection: AsyncConnection) -> list[User]:
    rows = (await connection.execute(users.select().order_by(users.c.name).limit(MAX_USERS))).all()
    return [User(row.name, Role(row.role), row.password, row.changed_ns) for row in rows]


def _row_of(of: User | Login) -> dict[str, Any]:
    return dataclasses.asdict(of)
