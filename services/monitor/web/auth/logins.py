"""The logged-in users, kept in memory too, so that log-in works while the database is missing."""

import asyncio
import hmac
import logging
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Final

from services.monitor.history.state import HistoryError
from services.monitor.web.auth.gate import SET_UP
from services.monitor.web.auth.passwords import BusyError, FailureLimit, Passwords, mistake_in
from services.monitor.web.auth.store import UserStore
from services.monitor.web.auth.users import (
    MAX_LOGINS,
    Kind,
    Login,
    Role,
    User,
    Visitor,
    digest_of,
    mistake_in_name,
    new_secret,
)

log = logging.getLogger(__name__)

LOOK_S: Final = 2.0
"""Seconds between reads of changes by another monitor, or `fleetsight users`."""

END_S: Final = 1.0
"""Seconds allowed for the last write."""

PROLONG_SHARE: Final = 0.1
"""Share of a session's time after which its end is moved."""


class AccessError(Exception):
    """Access is refused; the message says why. wait_s: when to try again, 0 if that does not help."""

    def __init__(self, reason: str, wait_s: float = 0.0) -> None:
        super().__init__(reason)
        self.wait_s = wait_s


class Access:
    """Users, sessions and tokens. problem: why users cannot be read or sessions not be saved, or empty.

    url: where people reach us, for the link that the first user is made with.
    """

    def __init__(
        self, store: UserStore, session_hours: float, url: str = "", now_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self.problem = ""
        self._setup_secret = secrets.token_urlsafe(16)
        self._url = url
        self._store = store
        self._session_ns = round(session_hours * 3_600e9)
        self._now_ns = now_ns
        self._passwords = Passwords()
        self._limit = FailureLimit()
        self._users: dict[str, User] | None = None
        self._logins: dict[str, Login] = {}
        self._made: dict[str, Login] = {}
        self._prolonged: dict[str, Login] = {}
        self._ended: set[str] = set()
        self._looking = asyncio.Lock()

    @property
    def needs_setup(self) -> bool:
        """Whether it is certain that there are no users yet."""
        return self._users is not None and not self._users and not self._store.left_out

    @property
    def invitation(self) -> str:
        """The link for the first user; empty once there is one."""
        return f"{self._url}{SET_UP}?token={self._setup_secret}" if self.needs_setup else ""

    async def run(self) -> None:
        """Stay in sync with the database until cancelled; pending changes are written at the end."""
        try:
            while True:
                await self.look()
                await asyncio.sleep(LOOK_S)
        finally:
            with suppress(TimeoutError):
                async with asyncio.timeout(END_S):
                    await self._write()

    async def look(self) -> None:
        """Write local changes and read those of others."""
        async with self._looking:
            self.problem = await self._write() or await self._read()

    async def _write(self) -> str:
        """Return why it cannot be done, or nothing."""
        made, prolonged, ended = dict(self._made), dict(self._prolonged), set(self._ended)
        if not (made or prolonged or ended):
            return ""
        try:
            await self._store.keep(made.values(), prolonged.values(), ended, self._now_ns())
        except HistoryError as error:
            await self._read()
            return self._wrong("log-ins are not being saved", error)
        self._made = {digest: login for digest, login in self._made.items() if digest not in made}
        self._prolonged = {digest: login for digest, login in self._prolonged.items() if prolonged.get(digest) != login}
        self._ended -= ended
        return ""

    async def _read(self) -> str:
        """Return why it cannot be done, or nothing."""
        try:
            users, logins = await self._store.load(self._now_ns())
        except HistoryError as error:
            return self._wrong("the users cannot be read", error)
        is_first, self._users = self._users is None, {user.name: user for user in users}
        if is_first and self.needs_setup:
            log.info("no users yet: create the first one at %s", self.invitation)
        known = {login.digest: login for login in logins if login.digest not in self._ended}
        mine = {digest: login for digest, login in self._prolonged.items() if digest in known}
        self._logins = {**known, **mine, **self._made}
        return ""

    async def log_in(self, name: str, password: str, address: str) -> str:
        """Return the secret of a new session.

        Raises:
            AccessError: it is not right, or too many tries were not.
        """
        self._hold_back(address, name)
        if self._users is None:
            await self.look()
        if self._users is None:
            raise AccessError("nobody can log in: the users cannot be read", LOOK_S)
        self._limit.failed(address, name, time.monotonic())
        user = self._users.get(name)
        try:
            is_right = await self._passwords.check(None if user is None else user.password, password)
        except BusyError as error:
            self._limit.unknown(address, name)
            raise AccessError(str(error), LOOK_S) from error
        if user is None or not is_right:
            log.warning("log-in of %s from %s failed", name[:64], address)
            raise AccessError("wrong name or password")
        self._limit.succeeded(address, name)
        log.info("%s logged in from %s", name, address)
        return self._open(user)

    async def set_up(self, secret: str, name: str, password: str, address: str) -> str:
        """Create the first user, an operator; return the secret of a session.

        Raises:
            AccessError: the secret is not that of the link, there are users already, or name or password will not do.
        """
        self._hold_back(address, "")
        if not hmac.compare_digest(secret.encode("utf-8", "replace"), self._setup_secret.encode()):
            self._limit.failed(address, "", time.monotonic())
            raise AccessError("invalid set-up link; use the one in the monitor's terminal or log")
        if wrong := mistake_in_name(name) or mistake_in(password):
            raise AccessError(wrong)
        try:
            user = User(name, Role.OPERATOR, await self._passwords.hash(password), self._now_ns())
            if not await self._store.add(user, first=True):
                raise AccessError("the first user has been made already: log in, or have an operator make you one")
        except (HistoryError, BusyError) as error:
            raise AccessError(f"the user cannot be saved: {error}", LOOK_S) from error
        self._setup_secret = secrets.token_urlsafe(16)
        await self.look()
        log.info("%s is the first user, set up from %s", name, address)
        return self._open(user)

    def log_out(self, secret: str) -> None:
        """End a session."""
        digest = digest_of(secret)
        if self._login(digest, Kind.SESSION) is not None:
            self._end(digest)

    def visitor(self, secret: str, kind: Kind) -> Visitor | None:
        """Return the visitor of a valid session or token; a session's end moves on."""
        digest = digest_of(secret)
        login = self._login(digest, kind)
        if login is None or self._role(digest, kind) is None:
            return None
        self._use(digest, kind)
        return Visitor(login.user, partial(self._role, digest, kind), partial(self._use, digest, kind))

    def _role(self, digest: str, kind: Kind) -> Role | None:
        login = self._login(digest, kind)
        user = None if login is None or self._users is None else self._users.get(login.user)
        return None if user is None or login is None or login.user_ns != user.changed_ns else user.role

    def _login(self, digest: str, kind: Kind) -> Login | None:
        login = self._logins.get(digest)
        return login if login is not None and login.kind is kind and self._now_ns() < login.until_ns else None

    def _open(self, user: User) -> str:
        secret = new_secret(Kind.SESSION)
        theirs = sorted(
            (login for login in self._logins.values() if login.user == user.name and login.kind is Kind.SESSION),
            key=lambda login: login.until_ns,
        )
        for login in theirs[: max(0, len(theirs) - MAX_LOGINS + 1)]:
            self._end(login.digest)
        until_ns = self._now_ns() + self._session_ns
        made = Login(digest_of(secret), user.name, Kind.SESSION, user.changed_ns, until_ns)
        self._logins[made.digest] = self._made[made.digest] = made
        return secret

    def _use(self, digest: str, kind: Kind) -> None:
        login, until_ns = self._login(digest, kind), self._now_ns() + self._session_ns
        if login is None or kind is not Kind.SESSION:
            return
        if until_ns - login.until_ns > PROLONG_SHARE * self._session_ns:
            longer = replace(login, until_ns=until_ns)
            self._logins[digest] = longer
            (self._made if digest in self._made else self._prolonged)[digest] = longer

    def _end(self, digest: str) -> None:
        for of in (self._logins, self._made, self._prolonged):
            of.pop(digest, None)
        self._ended.add(digest)

    def _hold_back(self, address: str, name: str) -> None:
        wait_s = self._limit.wait_s(address, name, time.monotonic())
        if wait_s:
            raise AccessError("too many failed attempts; wait some minutes", wait_s)

    def _wrong(self, what: str, error: HistoryError) -> str:
        if not self.problem.startswith(what):
            log.warning("%s: %s", what, error)
        return f"{what}: {error}"
