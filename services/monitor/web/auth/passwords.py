"""Passwords as argon2 hashes, made and checked on a thread, one at a time: each costs tens of milliseconds."""

import asyncio
from typing import Final

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

MIN_LENGTH: Final = 10
MAX_LENGTH: Final = 256

MEMORY_KIB: Final = 19 * 1024
ITERATIONS: Final = 2
"""With MEMORY_KIB what OWASP asks of argon2id at least; more would let strangers load the monitor."""

MAX_WAITING: Final = 16


class BusyError(Exception):
    """Too many passwords wait to be checked."""


class Passwords:
    """Hashes passwords and checks them."""

    def __init__(self) -> None:
        self._hasher = PasswordHasher(time_cost=ITERATIONS, memory_cost=MEMORY_KIB, parallelism=1)
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._nobodys = ""

    async def hash(self, password: str) -> str:
        """Return the hash of a password, with its salt.

        Raises:
            BusyError: too many wait already.
        """
        return await self._in_turn(password, None)

    async def check(self, hashed: str | None, password: str) -> bool:
        """Return whether a hash is the password's; it takes as long where there is none.

        Raises:
            BusyError: too many wait already.
        """
        return bool(await self._in_turn(password, hashed or ""))

    async def _in_turn(self, password: str, hashed: str | None) -> str:
        if self._waiting >= MAX_WAITING:
            raise BusyError("too many people log in at the same time")
        self._waiting += 1
        try:
            async with self._turn:
                return await asyncio.to_thread(self._work, password, hashed)
        finally:
            self._waiting -= 1

    def _work(self, password: str, hashed: str | None) -> str:
        if hashed is None:
            return self._hasher.hash(password)
        if not self._nobodys:
            self._nobodys = self._hasher.hash("")
        try:
            self._hasher.verify(hashed or self._nobodys, password)
        except (VerificationError, InvalidHashError):
            return ""
        return hashed


def mistake_in(password: str) -> str:
    """Return what is wrong with a new password, or nothing."""
    if not MIN_LENGTH <= len(password) <= MAX_LENGTH:
        return f"a password has {MIN_LENGTH} to {MAX_LENGTH} characters"
    try:
        password.encode()
    except UnicodeEncodeError:
        return "a password is text in UTF-8"
    if len(set(password)) < MIN_LENGTH // 2:
        return f"a password has at least {MIN_LENGTH // 2} different characters"
    return ""
