"""Password hashes (argon2), computed on a thread, one at a time: each costs tens of milliseconds."""

import asyncio
import ipaddress
from collections import OrderedDict, deque
from typing import Final

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

MIN_LENGTH: Final = 10
MAX_LENGTH: Final = 256

MEMORY_KIB: Final = 19 * 1024
ITERATIONS: Final = 2
"""With MEMORY_KIB, OWASP's minimum for argon2id; more would let strangers overload the monitor."""

MAX_WAITING: Final = 16


class BusyError(Exception):
    """Too many passwords wait to be checked."""


class Passwords:
    """Hashes passwords and checks them."""

    def __init__(self) -> None:
        self._hasher = PasswordHasher(time_cost=ITERATIONS, memory_cost=MEMORY_KIB, parallelism=1)
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._dummy_hash = ""

    async def hash(self, password: str) -> str:
        """Return the salted hash of a password.

        Raises:
            BusyError: too many wait already.
        """
        return await self._in_turn(password, None)

    async def check(self, hashed: str | None, password: str) -> bool:
        """Return whether a hash matches the password; it takes as long without a hash.

        Raises:
            BusyError: too many wait already.
        """
        return bool(await self._in_turn(password, hashed or ""))

    async def _in_turn(self, password: str, hashed: str | None) -> str:
        if self._waiting >= MAX_WAITING:
            raise BusyError("too many people are logging in; try again later")
        self._waiting += 1
        try:
            async with self._turn:
                return await asyncio.to_thread(self._work, password, hashed)
        finally:
            self._waiting -= 1

    def _work(self, password: str, hashed: str | None) -> str:
        if hashed is None:
            return self._hasher.hash(password)
        if not self._dummy_hash:
            self._dummy_hash = self._hasher.hash("")
        try:
            self._hasher.verify(hashed or self._dummy_hash, password)
        except (VerificationError, InvalidHashError):
            return ""
        return hashed


def mistake_in(password: str) -> str:
    """Return why a new password is refused, or nothing."""
    if not MIN_LENGTH <= len(password) <= MAX_LENGTH:
        return f"a password has {MIN_LENGTH} to {MAX_LENGTH} characters"
    try:
        password.encode()
    except UnicodeEncodeError:
        return "a password is text in UTF-8"
    if len(set(password)) < MIN_LENGTH // 2:
        return f"a password has at least {MIN_LENGTH // 2} different characters"
    return ""


WINDOW_S: Final = 900.0
MAX_OF_NAME: Final = 5
"""Failures of one name from one address."""

MAX_OF_ADDRESS: Final = 30
"""Failures of all names from one address."""

MAX_KEYS: Final = 10_000
MAX_NAME: Final = 64
"""Characters of a name that are remembered: names are arbitrary."""


class FailureLimit:
    """Counts failures by address, and by address and name; failures elsewhere lock nobody out."""

    def __init__(self) -> None:
        self._failures: OrderedDict[tuple[str, ...], deque[float]] = OrderedDict()

    def wait_s(self, address: str, name: str, now_s: float) -> float:
        """Return the seconds until the next attempt is allowed; 0 if it is allowed now."""
        every, own = _keys(address, name)
        return max(self._wait_s(every, MAX_OF_ADDRESS, now_s), self._wait_s(own, MAX_OF_NAME, now_s))

    def failed(self, address: str, name: str, now_s: float) -> None:
        """Count a failure; call it before checking the password, so that concurrent attempts count too."""
        for key, most in zip(_keys(address, name), (MAX_OF_ADDRESS, MAX_OF_NAME), strict=True):
            self._failures.setdefault(key, deque(maxlen=most)).append(now_s)
            self._failures.move_to_end(key)
        while len(self._failures) > MAX_KEYS:
            self._failures.popitem(last=False)

    def succeeded(self, address: str, name: str) -> None:
        """Take back the failure counted before a correct password."""
        self.unknown(address, name)
        self._failures.pop(_keys(address, name)[1], None)

    def unknown(self, address: str, name: str) -> None:
        """Take back the failure counted before a password that could not be checked in time."""
        for key in _keys(address, name):
            if times := self._failures.get(key):
                times.pop()

    def _wait_s(self, key: tuple[str, ...], most: int, now_s: float) -> float:
        times = self._failures.get(key)
        return max(0.0, times[0] + WINDOW_S - now_s) if times and len(times) >= most else 0.0


def _keys(address: str, name: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    of = network_of(address)
    return (of,), (of, name[:MAX_NAME])


def network_of(address: str) -> str:
    """Return the network that an address counts for: the address itself, or a subscriber's IPv6 network."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address[:64]
    if found.version == 6 and found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(found) if found.version == 4 else str(ipaddress.ip_network(f"{found}/64", strict=False))
