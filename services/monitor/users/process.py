"""`fleetsight users`."""

import asyncio
import getpass
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from services.monitor.users.settings import UsersSettings
from services.monitor.web.auth.passwords import MAX_LENGTH, Passwords, mistake_in
from services.monitor.web.auth.people import MAX_USERS, Kind, Login, User, digest_of, mistake_in_name, new_secret
from services.monitor.web.auth.store import UserStore, users_url
from services.monitor.web.auth.visitor import Role

DAY_NS: Final = 86_400 * 1_000_000_000


class UsersError(Exception):
    """What is asked for cannot be done; the message says why."""


async def run(settings: UsersSettings) -> None:
    """Do it, and say what was done.

    Raises:
        UsersError: it cannot be done.
        HistoryError: the database cannot be had.
    """
    store = UserStore(users_url(settings.history))
    if settings.task == "list":
        sys.stdout.writelines(f"{user.name} {user.role}\n" for user in await store.users())
        return
    if wrong := mistake_in_name(settings.name):
        raise UsersError(wrong)
    sys.stdout.write(await _change(settings, store) + "\n")


async def _change(settings: UsersSettings, store: UserStore) -> str:
    name, there = settings.name, {user.name: user for user in await store.users()}
    user = there.get(name)
    if settings.task == "add":
        if user is not None or len(there) >= MAX_USERS:
            raise UsersError(f"there is a user {name} already" if user else f"there are {MAX_USERS} users already")
        role = settings.role or Role.VIEWER
        await store.add(User(name, role, await _hashed(), time.time_ns()))
        return f"{name} may log in: {role}"
    if user is None:
        raise UsersError(f"there is no user {name}")
    if settings.task == "remove":
        await store.remove(name)
        return f"{name} may not log in any more"
    if settings.task == "reset":
        other = replace(user, role=settings.role or user.role, password=await _hashed(), changed_ns=time.time_ns())
        await store.change(other)
        return f"{name} has another password: {other.role}; every session and token has ended"
    secret, until_ns = new_secret(Kind.TOKEN), time.time_ns() + round(settings.days * DAY_NS)
    login = Login(digest_of(secret), name, Kind.TOKEN, user.changed_ns, until_ns)
    await store.keep([login], [], [], time.time_ns())
    return secret


async def _hashed() -> str:
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
