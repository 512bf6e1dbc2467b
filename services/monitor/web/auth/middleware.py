"""The access middleware: identifies senders, checks permissions and limits request bodies."""

import asyncio
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Final
from urllib.parse import quote

from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import cookie_parser
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.monitor.web.auth.gate import LOG_IN, SET_UP, RequestInfo, ServedAt, Verdict, body_limit, host_of, judge
from services.monitor.web.auth.logins import Access
from services.monitor.web.auth.users import STATE, Kind, Visitor
from services.monitor.web.connections import KNOWN

PAGE_POLICY: Final = (
    "default-src 'self'; "
    "script-src 'self' 'unsafe-inline' 'unsafe-eval'; "  # the page's templates are compiled in the browser
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; "
    "object-src 'none'; base-uri 'self'; form-action 'self'; frame-ancestors 'none'"
)
"""Browsers load content from this server only."""

FORM_POLICY: Final = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)

DEFAULTS: Final = {
    "Content-Security-Policy": PAGE_POLICY,
    "Referrer-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def problem(status: int, reason: str, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """Return an error response."""
    return JSONResponse({"error": reason}, status, headers=headers)


HTTPS_ONLY: Final = {"Strict-Transport-Security": "max-age=86400"}
"""For a day browsers come to this host by HTTPS alone, at every port, whatever somebody types (RFC 6797)."""


def with_headers(send: Send, *, secure: bool) -> Send:
    """Return a `send` that adds the DEFAULTS missing from a response. secure: it is sent over HTTPS only."""
    defaults = {**DEFAULTS, **HTTPS_ONLY} if secure else DEFAULTS

    async def sending(message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            headers = MutableHeaders(scope=message)
            for name, value in defaults.items():
                headers.setdefault(name, value)
        await send(message)

    return sending


BEARER: Final = "bearer "
MAX_SECRET: Final = 256
LOOK_S: Final = 2.0
"""Seconds within which a WebSocket ends after its visitor was logged out."""

BODY_S: Final = 30.0
"""Seconds allowed for a whole request: strangers could otherwise keep a connection for ever."""

GONE_S: Final = 10.0
"""Seconds after which a WebSocket client that takes no data counts as gone: its data would fill memory."""

POLICY_VIOLATION: Final = 1008

RETRY_S: Final = 2
"""Seconds after which a user with too many open requests may ask again."""


def _nothing() -> None:
    """Do nothing, for requests without a connection of their own."""


def _crowded(most: int) -> str:
    return f"you have {most} requests open already; close other pages or programs of yours, or ask again later"


def _misdirected(host: str) -> str:
    if not re.fullmatch(r"[a-z0-9_.-]{1,253}", host):
        return "the request names no host of this monitor"
    return (
        f"unknown host name {host}; if it is this monitor's, start it with --web-host-names {host}, or with --web-url"
        " where a proxy is in front"
    )


class AccessMiddleware:
    """Passes on permitted requests with their visitor; ends WebSockets of visitors without permission.

    most_of_user: requests and WebSockets that a user may have open at once; more are answered with 503.
    """

    def __init__(
        self,
        app: ASGIApp,
        access: Access,
        *,
        cookie: str,
        place: ServedAt,
        most_of_user: int = 250,
        body_s: float = BODY_S,
        gone_s: float = GONE_S,
    ) -> None:
        self.app = app
        self._body_s = body_s
        self._gone_s = gone_s
        self._access = access
        self._cookie = cookie
        self._place = place
        self._most_of_user = most_of_user
        self._open = Counter[str]()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        asking = _asking(scope)
        visitor, by = self._known(asking.headers)
        verdict = judge(asking, visitor, by=by, place=self._place)
        scope[STATE] = visitor
        send = with_headers(send, secure=self._place.secure)
        if verdict is not Verdict.PASS or (asking.is_socket and visitor is None):
            await self._refusal(asking, verdict)(scope, receive, send)
        elif visitor is None:
            await self._pass_on(asking, visitor, scope, receive, send)
        elif self._open[visitor.name] >= self._most_of_user:
            await problem(503, _crowded(self._most_of_user), {"Retry-After": str(RETRY_S)})(scope, receive, send)
        else:
            scope.get(KNOWN, _nothing)()
            with self._counted(visitor.name):
                await self._pass_on(asking, visitor, scope, receive, send)

    @contextmanager
    def _counted(self, name: str) -> Iterator[None]:
        """Count a user's request while it is open."""
        self._open[name] += 1
        try:
            yield
        finally:
            self._open[name] -= 1
            if not self._open[name]:
                del self._open[name]

    async def _pass_on(
        self, asking: RequestInfo, visitor: Visitor | None, scope: Scope, receive: Receive, send: Send
    ) -> None:
        limit = body_limit(asking.path)
        if asking.is_socket and visitor is not None:
            await self._socket(visitor, scope, receive, send)
        elif _announced(asking.headers) > limit:
            await problem(413, f"a request to {asking.path[:80]} has at most {limit} bytes")(scope, receive, send)
        else:
            await self.app(scope, _bounded(receive, limit, self._body_s), send)

    def _known(self, headers: Mapping[str, str]) -> tuple[Visitor | None, Kind | None]:
        """Return a request's sender and kind of credential; if there is a token, only it counts."""
        given = headers.get("authorization", "")
        if given:
            token = given[len(BEARER) :].strip() if given[: len(BEARER)].lower() == BEARER else ""
            return self._access.visitor(token[:MAX_SECRET], Kind.TOKEN), Kind.TOKEN
        secret = cookie_parser(headers.get("cookie", "")).get(self._cookie, "")
        return self._access.visitor(secret, Kind.SESSION) if secret else None, Kind.SESSION

    def _refusal(self, asking: RequestInfo, verdict: Verdict) -> Response:
        match verdict:
            case Verdict.MISDIRECTED:
                return problem(421, _misdirected(host_of(asking.headers)))
            case Verdict.FOREIGN:
                return problem(403, "this request does not come from a page of this monitor")
            case Verdict.NOT_ALLOWED:
                return problem(403, "only operators may do this")
        if asking.for_program or asking.method not in ("GET", "HEAD"):
            return problem(401, "log in, or send a token: Authorization: Bearer ...", {"WWW-Authenticate": "Bearer"})
        if self._access.needs_setup:
            return RedirectResponse(SET_UP, 303)
        asked = f"{asking.path}?{asking.query}" if asking.query else asking.path
        return RedirectResponse(f"{LOG_IN}?next={quote(asked, safe='/')}" if asked != "/" else LOG_IN, 303)

    async def _socket(self, visitor: Visitor, scope: Scope, receive: Receive, send: Send) -> None:
        watched = _Watched(visitor, receive, send, self._gone_s)
        try:
            await self.app(scope, watched.receive, watched.send)
        finally:
            watched.end()


class _Watched:
    """A WebSocket that ends when its visitor loses permission, or takes no data."""

    def __init__(self, visitor: Visitor, receive: Receive, send: Send, gone_s: float) -> None:
        self._visitor = visitor
        self._receive = receive
        self._send = send
        self._gone_s = gone_s
        self._is_gone = False
        self._next: asyncio.Future[Message] | None = None

    async def receive(self) -> Message:
        """Return the next message."""
        self._next = self._next or asyncio.ensure_future(self._receive())
        while self._visitor.may_look and not self._is_gone:
            await asyncio.wait([self._next], timeout=LOOK_S)
            if self._next.done():
                message, self._next = self._next.result(), None
                return message
        with suppress(TimeoutError):
            await self.send({"type": "websocket.close", "code": POLICY_VIOLATION})
        return {"type": "websocket.disconnect", "code": POLICY_VIOLATION}

    async def send(self, message: Message) -> None:
        """Send a message; after the first one that is not taken in time, raise TimeoutError."""
        if self._is_gone:
            return
        try:
            async with asyncio.timeout(self._gone_s):
                await self._send(message)
        except TimeoutError:
            self._is_gone = True
            raise

    def end(self) -> None:
        """Stop waiting."""
        if self._next is not None:
            self._next.cancel()


def _bounded(receive: Receive, limit: int, within_s: float) -> Receive:
    """Return a `receive` for a request's body, limited in bytes and seconds, that then reports its end."""
    left, until_s = limit, asyncio.get_running_loop().time() + within_s
    whole = False

    async def bounded() -> Message:
        nonlocal left, whole
        try:
            async with asyncio.timeout_at(None if whole else until_s):
                message = await receive()
        except TimeoutError as error:
            raise HTTPException(
                408, f"a request has to arrive within {within_s:g} s", {"Connection": "close"}
            ) from error
        whole = whole or not message.get("more_body", False)
        left -= len(message.get("body", b""))
        if left < 0:
            raise HTTPException(413, f"a request has at most {limit} bytes here")
        return message

    return bounded


def _announced(headers: Mapping[str, str]) -> int:
    given = headers.get("content-length", "0")
    return int(given) if given.isascii() and given.isdigit() and len(given) < 20 else 0


def _asking(scope: Scope) -> RequestInfo:
    headers: dict[str, str] = {}
    for raw_name, raw_value in scope["headers"]:
        name, value = raw_name.decode("latin-1").lower(), raw_value.decode("latin-1")
        between = "; " if name == "cookie" else ", "  # a repeated header becomes one invalid value
        headers[name] = f"{headers[name]}{between}{value}" if name in headers else value
    return RequestInfo(
        scope.get("method", ""), scope["path"], headers, scope.get("query_string", b"").decode("latin-1")
    )
