"""`fleetsight users`: manages the users of a monitor, whether it runs or not."""

import asyncio
import getpass
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from services.monitor.formats import natural
from services.monitor.history.engine import engine_of, name_of
from services.monitor.settings import UsersSettings
from services.monitor.web.auth.passwords import MAX_LENGTH, Passwords, mistake_in
from services.monitor.web.auth.store import UserStore, users_url
from services.monitor.web.auth.users import MAX_USERS, Kind, Login, Role, User, digest_of, mistake_in_name, new_secret
from services.option_names import terminal_left_as_it_is

DAY_NS: Final = 86_400 * 1_000_000_000


class UsersError(Exception):
    """The task failed; the message says why."""


async def run(settings: UsersSettings) -> None:
    """Run the task; print the database and the result.

    Raises:
        UsersError: it cannot be done.
        HistoryError: the database cannot be had, or is not there and nobody is added.
    """
    if settings.task != "list" and (wrong := mistake_in_name(settings.name)):
        raise UsersError(wrong)
    added = settings.task == "add"
    hashed = await _hashed() if added else ""
    url = users_url(settings.history)
    store = UserStore(url, create=added)
    there = {user.name: user for user in await store.users()}
    sys.stderr.write(f"database: {name_of(engine_of(url))}\n")
    if settings.task == "list":
        sys.stdout.writelines(
            f"{user.name} {user.role}\n" for user in sorted(there.values(), key=lambda user: natural(user.name))
        )
    elif added:
        sys.stdout.write(await _add(settings, store, there, hashed) + "\n")
    else:
        sys.stdout.write(await _change(settings, store, there) + "\n")


async def _add(settings: UsersSettings, store: UserStore, there: Mapping[str, User], hashed: str) -> str:
    name, role = settings.name, settings.role or Role.VIEWER
    if len(there) + len(store.left_out) >= MAX_USERS:
        raise UsersError(f"there are {MAX_USERS} users already")
    if name in store.left_out or not await store.add(User(name, role, hashed, time.time_ns())):
        raise UsersError(f"there is a user {name} already")
    return f"{name} may log in: {role}"


async def _change(settings: UsersSettings, store: UserStore, there: Mapping[str, User]) -> str:
    name = settings.name
    user = there.get(name)
    if settings.task == "remove":
        if not await store.remove(name):
            raise UsersError(f"there is no user {name}")
        return f"{name} may not log in any more"
    if user is None:
        unknown = f"{name} has a role that this version does not know"
        raise UsersError(unknown if name in store.left_out else f"there is no user {name}")
    if settings.task == "reset":
        other = replace(user, role=settings.role or user.role, password=await _hashed(), changed_ns=time.time_ns())
        await store.change(other)
        return f"{name} has another password: {other.role}; every session and token has ended"
    secret, until_ns = new_secret(Kind.TOKEN), time.time_ns() + round(settings.days * DAY_NS)
    login = Login(digest_of(secret), name, Kind.TOKEN, user.changed_ns, until_ns)
    await store.keep([login], [], [], time.time_ns())
    return secret


async def _hashed() -> str:
    with terminal_left_as_it_is():
        password = await asyncio.to_thread(read_password, getpass.getpass)
    if wrong := mistake_in(password):
        raise UsersError(wrong)
    return await Passwords().hash(password)


def read_password(ask: Callable[[str], str]) -> str:
    """Return a new password: asked for twice on a terminal, else the first line of standard input."""
    if not sys.stdin.isatty():
        return sys.stdin.readline(MAX_LENGTH + 2).rstrip("\r\n")
    password = ask("Password: ")
    if ask("Password again: ") != password:
        raise UsersError("the two passwords are not the same")
    return password
