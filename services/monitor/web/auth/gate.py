"""Access decisions by a request's method, path and headers. Pure."""

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from services.monitor.web.auth.users import Kind, Visitor

SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})

LOG_IN: Final = "/login"
LOG_OUT: Final = "/logout"
SET_UP: Final = "/setup"
HEALTH: Final = "/healthz"
METRICS: Final = "/metrics"
API: Final = "/api/"
PAGE_SOCKET: Final = "/_nicegui_ws/"

OPEN: Final = frozenset({LOG_IN, SET_UP, HEALTH})
"""Paths that need no log-in."""

MAX_BODY_BYTES: Final = 64 * 1024
MAX_PAGE_BODY_BYTES: Final = 1024 * 1024
"""Limit of posts by the page's own script where a browser cannot open a WebSocket."""


class Verdict(Enum):
    """The decision on a request."""

    PASS = auto()
    MISDIRECTED = auto()
    """The host is not ours: a foreign name that resolves to our address would let its own pages in."""
    FOREIGN = auto()
    """It comes from another site's page."""
    UNKNOWN = auto()
    """The sender is not logged in."""
    NOT_ALLOWED = auto()
    """The sender may read, but not act."""


@dataclass(frozen=True, slots=True)
class RequestInfo:
    """The parts of a request that decide about access. method: empty for a WebSocket. query: of its URL, raw."""

    method: str
    path: str
    headers: Mapping[str, str]
    query: str = ""

    @property
    def is_socket(self) -> bool:
        """Whether the request opens a WebSocket."""
        return not self.method

    @property
    def for_program(self) -> bool:
        """Whether errors are sent as JSON."""
        return self.path.startswith((API, PAGE_SOCKET)) or self.path == METRICS


@dataclass(frozen=True, slots=True)
class ServedAt:
    """Our own address. origin: that of a proxy in front, like https://fleet.example, or empty.

    hosts: allowed host names in lower case, without ports; addresses are allowed, too, and all names if it is empty.
    open_metrics: they need no token. secure: over our own HTTPS.
    """

    origin: str = ""
    hosts: frozenset[str] = frozenset()
    open_metrics: bool = False
    secure: bool = False


def judge(asking: RequestInfo, visitor: Visitor | None, *, by: Kind | None, place: ServedAt) -> Verdict:
    """Return the decision on a request. by: the visitor's kind of credential."""
    if not (_is_any_names(asking, visitor, by, place) or _is_our_name(host_of(asking.headers), place.hosts)):
        return Verdict.MISDIRECTED
    harmless = asking.method in SAFE
    known = visitor is not None and visitor.may_look
    abusable = known or asking.path in OPEN  # else refused below as not logged in: its token may be missing
    if not _is_ours(asking.headers, place, needed=abusable and not harmless and by is not Kind.TOKEN):
        return Verdict.FOREIGN
    if asking.path in OPEN or (place.open_metrics and asking.path == METRICS):
        return Verdict.PASS
    if visitor is None or not visitor.may_look:
        return Verdict.UNKNOWN
    looks = harmless or asking.is_socket or asking.path == LOG_OUT or asking.path.startswith(PAGE_SOCKET)
    return Verdict.PASS if looks or visitor.may_act else Verdict.NOT_ALLOWED


def body_limit(path: str) -> int:
    """Return the maximum size of a request's body for a path, in bytes."""
    return MAX_PAGE_BODY_BYTES if path.startswith(PAGE_SOCKET) else MAX_BODY_BYTES


def local_path(asked: str) -> str:
    """Return where to go after log-in: the requested path if it is ours, else the start page."""
    plain = asked.isascii() and asked.isprintable() and "\\" not in asked and len(asked) <= 1_000
    return asked if plain and asked.startswith("/") and not asked.startswith("//") else "/"


def host_of(headers: Mapping[str, str]) -> str:
    """Return the host that a request names, in lower case and without its port; empty if it names none."""
    host = headers.get("host", "").lower()
    return (host if host.endswith("]") else host.rpartition(":")[0] or host).removesuffix(".")


def _is_any_names(asking: RequestInfo, visitor: Visitor | None, by: Kind | None, place: ServedAt) -> bool:
    """Whether a request is answered under any name: it is a program's with a token, or the answer is for everybody.

    A token that is not known, or ended, is told as that.
    """
    program = by is Kind.TOKEN and (visitor is not None or asking.path not in OPEN)
    open_to_all = asking.path == HEALTH or (place.open_metrics and asking.path == METRICS)
    return not place.hosts or program or (open_to_all and asking.method in SAFE)


def _is_our_name(host: str, names: frozenset[str]) -> bool:
    """Whether a host is allowed; an address is, since nobody can have their name lead to it."""
    if host in names:
        return True
    try:
        ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


def _is_ours(headers: Mapping[str, str], place: ServedAt, *, needed: bool) -> bool:
    """Whether a request comes from a page of ours, or from no page at all.

    needed: it must say so: a browser sends its cookie along with whatever any page makes it send.
    """
    origin = headers.get("origin")
    if origin is None:
        return not needed
    if place.origin and (origin == place.origin or not _is_our_name(host_of(headers), place.hosts)):
        return origin == place.origin
    host = headers.get("host")
    return bool(host) and origin in (f"http://{host}", f"https://{host}")
