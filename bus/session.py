"""The thread that owns the Zenoh session: opening, declaring, undeclaring and closing may block, so it does them."""

import contextlib
import json
import logging
import queue
import re
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Final, Protocol

import zenoh
from zenoh.handlers import Callback

from bus.asking import Asking
from bus.config import session_config
from bus.connections import tune
from bus.errors import BusError, NotServedError
from bus.panics import panics_are_errors
from bus.queries import send_query
from bus.serving import serves
from bus.settings import BusSettings, port_of

RETRY_S: Final = 0.5

CUT_OFF_S: Final = 5.0
"""How long a client's session may have no link until it is seen whether another one gets it."""

SHORT_LIVED_S: Final = 10.0
"""A link that is lost sooner is one that its router had no time for: all of a large fleet join at once, for example."""

LONGER: Final = 4
"""How many times the lease of the next session is longer after such a link."""

LONGEST_LEASE_S: Final = 16.0
"""It does not become longer than this."""

_WHY: Final = {
    True: "the link was lost soon after it was made",
    False: "there was still no link though a router answers",
}

_log: Final = logging.getLogger(__name__)


class Declaration(Protocol):
    """Something declared on a session. Both methods are called on the session's thread only."""

    def declare(self, session: zenoh.Session) -> None:
        """Declare; may raise zenoh.ZError, and is then undeclared."""

    def undeclare(self) -> None:
        """Undo whatever `declare` got done; nothing if it was never called."""


class SessionThread:
    """Opens a session, again and again if it is a client's and nobody answers; declares what is kept on it."""

    def __init__(self, settings: BusSettings) -> None:
        self._settings = settings
        self._jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._kept: dict[Declaration, None] = {}
        self._session: zenoh.Session | None = None
        self._links: set[tuple[str, str]] = set()  # those that were sought
        self._stopping = threading.Event()
        self._stopped = False
        self._retry_at: float | None = None
        self._lease_s = self._leased_s = settings.lease_s  # of the next session, and of this one
        self._linked_at = float("-inf")
        self._thread = threading.Thread(target=self._run, name="bus-session", daemon=True)
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """Whether there is a session; its links may be down all the same."""
        return self._session is not None

    @property
    def link_problem(self) -> str:
        """Why nobody can be heard, in words, or empty."""
        if self._session is not None and (self._links or not self._settings.connect):
            return ""
        return f"there is no link to {self._where}"

    def open(self) -> Future[None]:
        """Try to open once; a client whose routers do not answer goes on trying by itself, others fail."""
        return self.submit(self._open)

    def keep(self, declaration: Declaration) -> Future[None]:
        """Declare, now or when the session is open."""
        return self.submit(lambda: self._declare(declaration))

    def drop(self, declaration: Declaration) -> Future[None]:
        """Undeclare."""
        return self.submit(lambda: self._undeclare(declaration))

    def ask(self, asking: Asking) -> None:
        """Send a request; its outcome comes by itself."""
        self._do(partial(self._ask, asking))

    def stop(self, then: Callable[[], None]) -> Future[None]:
        """Undeclare everything, close the session, call `then`, end the thread."""
        self._stopping.set()
        return self.submit(lambda: self._stop(then))

    def submit(self, act: Callable[[], None]) -> Future[None]:
        """Have something done on the session's thread, after what was submitted before. Any thread."""
        future: Future[None] = Future()

        def job() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                with panics_are_errors():
                    act()
            except Exception as error:  # noqa: BLE001 - it belongs to whoever waits for the future
                future.set_exception(error)
            else:
                future.set_result(None)

        if self._thread.is_alive():
            self._jobs.put(job)
        else:
            future.set_result(None)
        return future

    def _do(self, act: Callable[[], None]) -> None:
        """Have something done that nobody waits for. Any thread."""
        self.submit(act).add_done_callback(_log_failure)

    def _run(self) -> None:
        while not self._stopped:
            try:
                job = self._jobs.get(
                    timeout=None if self._retry_at is None else max(0, self._retry_at - time.monotonic())
                )
            except queue.Empty:
                self._retry_at = time.monotonic() + RETRY_S
                self._do(self._open if self._session is None else self._replace)
            else:
                job()
        with contextlib.suppress(queue.Empty):
            while True:
                self._jobs.get_nowait()()

    def _open(self) -> None:
        if self._stopping.is_set():
            return
        first = self._retry_at is None
        try:
            session = self._opened()
        except zenoh.ZError as error:
            if self._settings.mode != "client":
                listen = self._settings.listen
                named = [endpoint for endpoint in listen if endpoint.partition("/")[2] in str(error)]
                raise BusError(
                    f"cannot open the bus as a {self._settings.mode} (listen {', '.join(named or listen)}): "
                    f"{_reason(error)}"
                ) from error
            if first:  # Zenoh does not say why: refused, not answered and another's certificate look the same
                _log.warning("waiting for a link to %s: no Zenoh router answers there", self._where)
            self._retry_at = time.monotonic() + RETRY_S
            return
        if self._settings.mode != "client" and self._settings.connect:
            _log.info("connecting to %s", self._where)
        self._use(session)

    def _opened(self) -> zenoh.Session:
        settings = self._settings.model_copy(update={"lease_s": self._lease_s})
        return zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(settings))))

    def _use(self, session: zenoh.Session) -> None:
        self._session, self._leased_s = session, self._lease_s
        self._links.clear()
        self._watch_for_links()
        listener = Callback(partial(self._on_link, session), indirect=False)
        session.info.declare_link_events_listener(listener, history=True)
        for declaration in list(self._kept):
            if self._stopping.is_set():
                return
            try:
                with panics_are_errors():
                    declaration.declare(session)
            except Exception:  # noqa: BLE001 - the others are declared, and this one on the next session
                _log.exception("a declaration was refused")
                _take_back(declaration)

    def _watch_for_links(self) -> None:
        """Have a client's session replaced if it has no link for long, or at once if the next one gets a longer lease.

        Zenoh (1.10) gives up for good on a link that is closed just as it comes up again. That is what a router does
        which has not yet noticed the end of the link before; as long as it takes the new one for the old one, it also
        mixes up what keys they speak of. It does not know a new session from before. And it may lose links that are
        not silent at all, when it is busy with others' declarations for longer than their lease.
        """
        now_s = time.monotonic()
        if self._settings.mode != "client" or (self._links and self._leased_s == self._lease_s):
            self._retry_at = None
        elif self._leased_s == self._lease_s:
            self._retry_at = now_s + CUT_OFF_S
        else:  # links that come and go do not put it off
            self._retry_at = min(now_s + RETRY_S, self._retry_at or now_s + RETRY_S)

    def _replace(self) -> None:
        """Go on with a new session, if one can be had and the last one is still to be replaced."""
        last, longer = self._session, self._leased_s != self._lease_s
        if last is None or self._stopping.is_set() or (self._links and not longer):
            self._watch_for_links()
            return
        try:
            session = self._opened()
        except zenoh.ZError:  # no router answers, or not in time: Zenoh tries, too
            self._watch_for_links()
            return
        if self._stopping.is_set() or (list(last.info.routers_zid()) and not longer):  # it got its link meanwhile
            _close(session)
            self._watch_for_links()
            return
        for declaration in self._kept:
            _take_back(declaration)
        _close(last)
        self._use(session)
        _log.warning("joined %s anew, with a lease of %g s: %s", self._where, self._lease_s, _WHY[longer])

    @property
    def _where(self) -> str:
        return ", ".join(self._settings.connect) or "any address found by scouting"

    def _on_link(self, session: zenoh.Session, event: zenoh.LinkEvent) -> None:
        """Have the session's thread act on it; this one is Zenoh's."""
        act = self._link_up if event.kind == zenoh.SampleKind.PUT else self._link_down
        self._do(partial(act, session, event.link.src, event.link.dst))

    def _link_up(self, session: zenoh.Session, own: str, other: str) -> None:
        tune(own)
        if session is self._session and self._is_sought(other):
            self._links.add((own, other))
            self._linked_at = time.monotonic()
            self._watch_for_links()
            _log.info("connected to %s", other)

    def _link_down(self, session: zenoh.Session, own: str, other: str) -> None:
        if session is not self._session or (own, other) not in self._links:
            return
        self._links.discard((own, other))
        if self._settings.mode == "client" and time.monotonic() < self._linked_at + SHORT_LIVED_S:
            self._lease_s = max(self._lease_s, min(LONGEST_LEASE_S, LONGER * self._leased_s))
        self._watch_for_links()
        if not self._stopped:
            _log.warning("lost the link to %s, waiting for one to %s", other, self._where)

    def _is_sought(self, other: str) -> bool:
        """Whether a link is one that was asked for, and not others' to us, as far as ports tell: hosts have names.

        Who scouts and names nobody to connect to asks for any.
        """
        settings = self._settings
        if settings.mode == "client" or (settings.scouting and not settings.connect):
            return True
        return port_of(other) in {port_of(endpoint) for endpoint in settings.connect}

    def _declare(self, declaration: Declaration) -> None:
        self._kept[declaration] = None
        if self._session is None:
            return
        try:
            declaration.declare(self._session)
        except zenoh.ZError as error:
            self._undeclare(declaration)
            raise BusError(f"cannot declare: {_reason(error)}") from error

    def _undeclare(self, declaration: Declaration) -> None:
        if declaration not in self._kept:
            return
        del self._kept[declaration]
        _take_back(declaration)

    def _ask(self, asking: Asking) -> None:
        if self._session is None:
            asking.settle(NotServedError(f"there is no router at {self._where} yet"))
            return
        try:
            send_query(self._session, asking, served_here=serves(asking.key, self._kept))
        except zenoh.ZError as error:
            asking.settle(BusError(f"cannot ask: {_reason(error)}"))

    def _stop(self, then: Callable[[], None]) -> None:
        self._stopped = True
        for declaration in list(self._kept):
            self._undeclare(declaration)
        if self._session is not None:
            _close(self._session)
        then()


def _take_back(declaration: Declaration) -> None:
    try:
        with panics_are_errors():
            declaration.undeclare()
    except Exception as error:  # noqa: BLE001 - the session may be gone already, or a thread stuck in the publisher
        _log.debug("undeclaring failed: %s", error)


def _close(session: zenoh.Session) -> None:
    try:
        with panics_are_errors():
            session.close()
    except (zenoh.ZError, BusError) as error:
        _log.warning("the session did not close cleanly: %s", _reason(error))


def _log_failure(done: Future[None]) -> None:
    if not done.cancelled() and (error := done.exception()) is not None:
        _log.error("the bus met an error: %s", error)


def _reason(error: zenoh.ZError | BusError) -> str:
    """Return what the system said, or Zenoh's message without the places in its own sources."""
    text = re.sub(r" at \S+\.rs:\d+\.?", "", str(error))
    said = re.search(r"([^:\[]+) \(os error \d+\)", text)
    return said[1].strip() if said else text
