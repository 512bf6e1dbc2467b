"""The thread that owns the Zenoh session and makes its blocking calls: open, declare, undeclare, close."""

import contextlib
import json
import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from random import uniform
from typing import Final

import zenoh
from zenoh.handlers import Callback

from bus.errors import BusError, NotServedError
from bus.requests.pending_request import PendingRequest
from bus.requests.queries import send_query
from bus.requests.serving import serves
from bus.session.access import check_closed, read_access
from bus.session.certificates import check_certificates
from bus.session.changed_files import LOOKED_AT_S, ChangedFiles
from bus.session.config import session_config
from bus.session.declaration import Declaration, close_session, endpoint_names, reason_of, take_back
from bus.session.job_thread import JobThread
from bus.session.known_keys import KeyNumbers
from bus.session.link_use import LinkUse
from bus.session.links import why_unreached
from bus.session.listening_client import LostLink, open_listening_client
from bus.session.panics import panics_are_errors
from bus.session.session_links import SessionLinks
from bus.session.tcp_options import TcpTuning
from bus.session.timing import POLL_S, REOPEN_PAUSE_S, RETRY_S, SETTLING_S, SHORT_SESSION_S
from bus.settings import BusSettings

IN_A_ROW: Final = 8
"""Declarations that a router receives before the thread waits for it to process them."""

TELL_AFTER_S: Final = 3.0
"""Time that a router or peer may take to connect before the log says that it waits."""

RENEWED_AFTER: Final = 10_000
"""Declarations after which a client opens a new session: each may use an id (see bus.session.known_keys)."""

OTHERS_RENEWED_AFTER: Final = 50_000
"""The same for a router or peer, whose links all end with it: only declarations that use a new id count."""

NEVER: Final = 0

_NOBODY: Final = "nobody"
"""A token that nobody declares."""

_log: Final = logging.getLogger(__name__)


class SessionThread:
    """Opens a session, retrying for a client whose routers do not answer, and makes the kept declarations on it.

    Another one follows that of a client whose only link is lost, any with very many declarations, and any whose
    certificates or access rules have changed: Zenoh reads them as a session opens. Zenoh's own (1.10) may go on with
    what a router has not yet taken for lost, and then mixes up what keys the two speak of; it may give up for good on a
    link that is closed as it comes up; and it declares everything at once. It still tries, once, until it is ended.
    A session to which others connect is left to Zenoh, since they would lose their links with it.

    prefix: see `bus.open_bus`. submit, do: see `JobThread`.
    """

    def __init__(self, settings: BusSettings, most_links: int, prefix: str = "") -> None:
        self._settings = settings
        self._config = partial(session_config, settings, most_links, prefix=prefix)
        self._kept: dict[Declaration, None] = {}
        self._numbers = KeyNumbers()
        self._session: zenoh.Session | None = None
        self._turn = NEVER  # callbacks compare it: a session they would release at any time (see REOPEN_PAUSE_S)
        self._links = SessionLinks(settings, most_links)
        self._lost_link = LostLink(settings)
        self._stopping = threading.Event()
        self._retry_at: float | None = None
        self._refused = False
        self._tell_at: float | None = None
        self._files = ChangedFiles([settings.tls_ca, settings.tls_certificate, settings.tls_key, settings.access])
        self._look_at = time.monotonic() + LOOKED_AT_S if self._files else None
        self._opened_at = 0.0
        self._unsettled = 0
        self._declared = 0  # on this session; a client counts all of them, since any key may be new
        self._cut = threading.Event()
        self._ended: zenoh.Session | None = None  # see REOPEN_PAUSE_S
        jobs = JobThread("bus-session", self._due, self._do_what_is_due)
        self.submit, self.do = jobs.submit, jobs.do
        self._jobs = jobs
        self._tuning = TcpTuning(self.do)

    @property
    def is_open(self) -> bool:
        """Whether a session is open; its links may still be down."""
        return self._session is not None

    @property
    def link_problem(self) -> str:
        """Why the bus has no link, in words, or empty."""
        if self._session is not None and (self._links or not self._settings.connect):
            return ""
        if self._session is None and self._turn != NEVER and not self._settings.has_one_link:
            return "the bus is being opened again"
        return f"there is no link to {self._where}"

    @property
    def links(self) -> LinkUse:
        """See `bus.api.Bus.links`."""
        return self._links.use

    def open(self) -> Future[None]:
        """Try to open once. A client whose routers do not answer keeps trying in the background; others fail."""
        return self.submit(self._begin)

    def keep(self, declaration: Declaration) -> Future[None]:
        """Declare, now or once the session is open."""
        return self.submit(lambda: self._declare(declaration))

    def drop(self, declaration: Declaration) -> Future[None]:
        """Undeclare."""
        return self.submit(lambda: self._undeclare(declaration))

    def ask(self, asking: PendingRequest) -> None:
        """Send a request; its outcome is set later."""
        self.do(partial(self._ask, asking))

    def stop(self, then: Callable[[], None]) -> Future[None]:
        """Undeclare everything, close the session, call `then`, and end the thread."""
        self._stopping.set()
        return self.submit(lambda: self._stop(then))

    def _begin(self) -> None:
        check_closed(self._settings)
        check_certificates(self._settings)
        self._open()

    def _due(self) -> float | None:
        times = (self._retry_at, self._tell_at, self._look_at, self._lost_link.due_s)
        return min((at for at in times if at is not None), default=None)

    def _do_what_is_due(self) -> None:
        now_s = time.monotonic()
        if self._tell_at is not None and self._tell_at <= now_s:
            self._tell_at = None
            self.do(self._tell)
        if self._look_at is not None and self._look_at <= now_s:
            self._look_at = now_s + LOOKED_AT_S
            self.do(self._look_at_files)
        if self._lost_link.due_s is not None and self._lost_link.due_s <= now_s:
            self._make_link_anew()
        if self._retry_at is not None and self._retry_at <= now_s:
            self._retry_after(RETRY_S)
            self.do(self._open)

    def _make_link_anew(self) -> None:
        if self._session is None or self._links:
            self._lost_link.settle(self._kept)
        elif self._lost_link.is_given_up() and not self._links:
            _log.info("opening a new session: %s takes links, and this one has none", self._where)
            self._end(self._session)

    def _look_at_files(self) -> None:
        """Open a new session if certificates or access rules have changed to something that can be used."""
        if self._session is None or not self._files.changed():
            return
        try:
            check_certificates(self._settings)
            read_access(self._settings)
        except BusError as error:
            self._files.use()
            _log.warning("%s; the bus uses the previous files until this is fixed", error)
            return
        _log.info("opening a new session: certificates or access rules have changed")
        self._end(self._session)

    def _open(self) -> None:
        self._ended = None
        if self._stopping.is_set():
            return
        first = self._retry_at is None
        try:
            session = self._opened()
        except (zenoh.ZError, OSError) as error:
            if not self._settings.has_one_link and self._turn == NEVER:
                listen = self._settings.listen
                named = [endpoint for endpoint in listen if endpoint.partition("/")[2] in str(error)]
                raise BusError(
                    f"cannot open the bus as a {self._settings.mode} (listen {', '.join(named or listen)}): "
                    f"{reason_of(error)}"
                ) from error
            if self._settings.has_one_link and first:
                self._warn_of(self._settings.connect)
            elif not self._settings.has_one_link and not self._refused:
                self._refused = True
                _log.warning("cannot open the bus again yet: %s", reason_of(error))
            self._retry_after(RETRY_S)
            return
        if not self._settings.has_one_link and self._settings.connect:
            _log.info("connecting to %s", self._where)
            self._tell_at = time.monotonic() + TELL_AFTER_S
        self._use(session)

    def _tell(self) -> None:
        """Log the endpoints to which a router or peer has no link: Zenoh keeps trying silently."""
        if missing := self._links.missing():
            self._warn_of(missing)

    def _warn_of(self, endpoints: Sequence[str]) -> None:
        _log.warning("waiting for a link to %s: %s", endpoint_names(endpoints), why_unreached(endpoints))

    def _opened(self) -> zenoh.Session:
        self._files.use()
        access = read_access(self._settings)
        self._links.begin(access)
        if self._settings.is_listening_client:
            return open_listening_client(lambda first: self._config(access=access, first=first))
        return zenoh.open(zenoh.Config.from_json5(json.dumps(self._config(access=access))))

    def _use(self, session: zenoh.Session) -> None:
        self._retry_at, self._refused = None, False
        self._session, self._opened_at = session, time.monotonic()
        self._turn += 1
        self._lost_link.begin()
        self._cut.clear()
        self._unsettled = self._declared = 0
        listener = Callback(partial(self._on_link, self._turn), indirect=False)
        session.info.declare_link_events_listener(listener, history=True)
        if self._settings.has_one_link and not session.info.links():
            _log.warning("lost the link to %s as it came up", self._where)
            self._end(session)
            return
        for declaration in list(self._kept):
            if self._stopping.is_set() or self._cut.is_set():
                return
            try:
                with panics_are_errors():
                    self._declare_on(session, declaration)
            except Exception:  # noqa: BLE001 - the others are declared, and this one on the next session
                _log.exception("a declaration was refused")
                take_back(declaration)

    def _declare_on(self, session: zenoh.Session, declaration: Declaration) -> None:
        self._numbers.keep(session, declaration.number_of)
        declaration.declare(session)
        self._settle(session)

    def _settle(self, session: zenoh.Session) -> None:
        """Wait after every IN_A_ROW declarations until the router has processed them.

        In a large fleet each takes it up to a millisecond. It processes all that it has read from a link before it
        reads others, and counts links as lost that it has not read for their lease time (Zenoh 1.10).
        """
        self._unsettled += 1
        if self._settings.mode != "client" or self._unsettled < IN_A_ROW:
            return
        self._unsettled = 0
        settled = threading.Event()
        callback: Callback[zenoh.Reply] = Callback(lambda _: None, settled.set, indirect=False)
        with contextlib.suppress(zenoh.ZError):
            session.liveliness().get(_NOBODY, callback, timeout=SETTLING_S)
            while not (settled.wait(POLL_S) or self._stopping.is_set() or self._cut.is_set()):
                pass

    def _end(self, session: zenoh.Session) -> None:
        """End the session and schedule a new one."""
        self._session, self._ended = None, session
        self._turn += 1
        self._links.clear()
        self._lost_link.end()
        close_session(session)  # first: Zenoh (1.10) makes the link anew at once, and declares everything on it
        for declaration in self._kept:
            take_back(declaration)
        self._numbers.forget()
        self._retry_after(REOPEN_PAUSE_S if time.monotonic() > self._opened_at + SHORT_SESSION_S else RETRY_S)

    def _retry_after(self, least_s: float) -> None:
        self._retry_at = time.monotonic() + uniform(least_s, 2 * least_s)  # noqa: S311 - no secret

    @property
    def _where(self) -> str:
        return endpoint_names(self._settings.connect)

    def _on_link(self, turn: int, event: zenoh.LinkEvent) -> None:
        """Pass a link event from Zenoh's thread to the session's thread."""
        up = event.kind == zenoh.SampleKind.PUT
        if not up and self._settings.has_one_link and turn == self._turn:
            self._cut.set()
        if up:
            self.do(partial(self._link_up, turn, event.link.src, event.link.dst, event.link.auth_identifier or ""))
        else:
            self.do(partial(self._link_down, turn, event.link.src, event.link.dst))

    def _link_up(self, turn: int, own: str, other: str, name: str) -> None:
        self._tuning.add(own)
        if turn == self._turn and self._links.add(own, other, name):
            self._lost_link.made(other)

    def _link_down(self, turn: int, own: str, other: str) -> None:
        ends = self._settings.has_one_link
        if turn != self._turn or self._session is None or not (self._links.remove(own, other) or ends):
            return
        if not self._jobs.is_ending:
            _log.warning("lost the link to %s, waiting for one to %s", other, self._where)
        if ends:
            self._end(self._session)
        else:
            self._lost_link.begin()

    def _declare(self, declaration: Declaration) -> None:
        self._kept[declaration] = None
        if self._session is None:
            return
        try:
            self._declare_on(self._session, declaration)
        except zenoh.ZError as error:
            self._undeclare(declaration)
            raise BusError(f"cannot declare: {reason_of(error)}") from error
        counts_all = self._settings.has_one_link
        self._declared += counts_all or declaration.takes_another
        if self._declared >= (RENEWED_AFTER if counts_all else OTHERS_RENEWED_AFTER):
            _log.info("opening a new session after %d declarations on this one", self._declared)
            self._end(self._session)

    def _undeclare(self, declaration: Declaration) -> None:
        if declaration not in self._kept:
            return
        del self._kept[declaration]
        take_back(declaration)

    def _ask(self, asking: PendingRequest) -> None:
        if self._session is None:
            asking.settle(NotServedError(f"there is no router at {self._where} yet"))
            return
        try:
            send_query(self._session, asking, served_here=serves(asking.key, self._kept))
        except zenoh.ZError as error:
            asking.settle(BusError(f"cannot ask: {reason_of(error)}"))

    def _stop(self, then: Callable[[], None]) -> None:
        self._jobs.end()
        for declaration in list(self._kept):
            self._undeclare(declaration)
        if self._session is not None:
            close_session(self._session)
            self._session = None
            self._numbers.forget()
        then()
