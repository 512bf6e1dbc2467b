"""The web application without its pages: log-in, API, health, metrics."""

from collections.abc import Sequence
from typing import Any, Final

from fastapi import APIRouter, Depends, FastAPI, HTTPException, Request, Security
from fastapi.exceptions import RequestValidationError, WebSocketRequestValidationError
from fastapi.openapi.models import HTTPBearer
from fastapi.responses import JSONResponse
from fastapi.security.base import SecurityBase
from pydantic import HttpUrl
from starlette.exceptions import HTTPException as StarletteHTTPException
from starlette.routing import BaseRoute, Match
from starlette.types import Receive, Scope, Send

from bus.reporting import VERSION
from services.monitor.history.state import HistoryError
from services.monitor.monitor import Monitor, RobotThereError, UnknownRobotError
from services.monitor.rules.subjects import UnknownAlertError
from services.monitor.settings import WebSettings
from services.monitor.web.api.alerts import about_routes, alert_routes
from services.monitor.web.api.fleet import fleet_routes
from services.monitor.web.api.history import history_routes
from services.monitor.web.api.live import live_routes
from services.monitor.web.api.models import ErrorAnswer
from services.monitor.web.api.objects import object_routes
from services.monitor.web.api.paging import refuse_unknown
from services.monitor.web.api.warehouses import warehouse_routes
from services.monitor.web.auth.gate import ServedAt
from services.monitor.web.auth.logins import Access
from services.monitor.web.auth.middleware import AccessMiddleware, problem
from services.monitor.web.auth.routes import access_routes
from services.monitor.web.connections import share_of
from services.monitor.web.metrics import watching_routes

METHODS: Final = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE")


class OtherMethods(BaseRoute):
    """Answers 405; it comes after some routes, and before those that match every path."""

    def __init__(self, routes: Sequence[BaseRoute]) -> None:
        self._routes = tuple(routes)

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Match a path that one of the routes serves with another method."""
        is_there = any(route.matches(scope)[0] is Match.PARTIAL for route in self._routes)
        return (Match.FULL if is_there else Match.NONE), {}

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Respond 405; for HEAD the server leaves out the body, which it recognizes by a scope of its own.

        Raises:
            HTTPException: the method is none of those that there are.
        """
        allowed, method = self._allowed(scope), scope["method"]
        if method in allowed:
            await scope["router"]({**scope, "method": _as(method)}, receive, send)
            return
        reason = f"{scope['path'][:200]} takes {' or '.join(allowed)}, not {method[:20]}"
        raise HTTPException(405, reason, {"Allow": ", ".join(allowed)})

    def _allowed(self, scope: Scope) -> list[str]:
        asked = ((method, {**scope, "method": _as(method)}) for method in METHODS)
        return [method for method, each in asked if any(route.matches(each)[0] is Match.FULL for route in self._routes)]


def _as(method: str) -> str:
    return "GET" if method == "HEAD" else method


class Token(SecurityBase):
    """Documents the token in the description of every call that depends on it."""

    def __init__(self) -> None:
        self.model = HTTPBearer(description="Output of `fleetsight users token NAME`.")
        self.scheme_name = "token"

    async def __call__(self) -> None:
        """Check nothing: `AccessMiddleware` has checked the request."""


ERRORS: Final[dict[int | str, dict[str, Any]]] = {"4XX": {"model": ErrorAnswer}, "5XX": {"model": ErrorAnswer}}

ABOUT: Final = """Objects in view. Log in with a token, `Authorization: Bearer ...`; `fleetsight users token NAME`
makes one. Operators may do everything, viewers only read. Errors are `{"error": "one line"}`. The same
data as it changes: WebSocket `/api/v1/live`."""


def make_application(monitor: Monitor, access: Access) -> FastAPI:
    """Return the application; put `guarded` in front of it."""
    app = FastAPI(
        title="fleetsight",
        version=VERSION,
        description=ABOUT,
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
    )
    api = APIRouter(prefix="/api/v1", responses=ERRORS, dependencies=[Security(Token()), Depends(refuse_unknown)])
    for routes in (
        about_routes(monitor),
        fleet_routes(monitor),
        alert_routes(monitor),
        history_routes(monitor),
        object_routes(monitor),
        warehouse_routes(monitor),
        live_routes(monitor),
    ):
        api.include_router(routes)
    app.include_router(api)
    app.include_router(access_routes(access, cookie=cookie_of(monitor.settings), secure=is_secure(monitor.settings)))
    app.include_router(watching_routes(monitor, access))
    app.router.routes.append(OtherMethods(app.router.routes))
    app.add_api_route("/api/{path:path}", _nothing_there, methods=list(METHODS), include_in_schema=False)
    app.add_api_websocket_route("/api/{path:path}", _no_socket_there)
    answer_errors(app)
    return app


def guarded(
    app: FastAPI, access: Access, settings: WebSettings, machine_names: frozenset[str] = frozenset()
) -> AccessMiddleware:
    """Return the application behind its access checks."""
    return AccessMiddleware(
        app,
        access,
        cookie=cookie_of(settings),
        place=place_of(settings, machine_names),
        most_of_user=share_of(settings.web_connections),
    )


def place_of(settings: WebSettings, machine_names: frozenset[str] = frozenset()) -> ServedAt:
    """Return where we are served: under which names a browser may come; over our own HTTPS its certificate says so."""
    url = settings.web_url
    names = {"localhost", settings.web_host.lower(), *settings.web_host_names, *machine_names}
    return ServedAt(
        origin="" if url is None else origin_of(url),
        hosts=frozenset() if settings.web_certificate else frozenset(names | ({url.host or ""} if url else set())),
        open_metrics=settings.web_open_metrics,
        secure=settings.web_certificate is not None,
    )


def is_secure(settings: WebSettings) -> bool:
    """Whether browsers reach us over HTTPS only."""
    return settings.web_certificate is not None or (settings.web_url is not None and settings.web_url.scheme == "https")


def cookie_of(settings: WebSettings) -> str:
    """Return the name of our cookie, which is unique by port: browsers send it to every port of a host."""
    return "__Host-fleetsight" if is_secure(settings) else f"fleetsight-{settings.web_port}"


def origin_of(url: HttpUrl) -> str:
    """Return the origin of an address, as browsers send it."""
    host, usual = url.host or "", {"http": 80, "https": 443}[url.scheme]
    return f"{url.scheme}://{host}" if url.port in (None, usual) else f"{url.scheme}://{host}:{url.port}"


async def _nothing_there(path: str) -> None:
    raise HTTPException(404, f"there is no /api/{path[:200]}")


async def _no_socket_there(path: str) -> None:
    raise HTTPException(404, f"there is no WebSocket at /api/{path[:200]}")


RETRY_S: Final = 2
"""Seconds after which a client retries while the history cannot be read."""


def answer_errors(app: FastAPI) -> None:
    """Register these error responses with an application, also for WebSockets that are not accepted yet."""
    app.add_exception_handler(StarletteHTTPException, _http)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(WebSocketRequestValidationError, _invalid)
    app.add_exception_handler(HistoryError, _no_history)
    app.add_exception_handler(UnknownAlertError, _not_found)
    app.add_exception_handler(UnknownRobotError, _not_found)
    app.add_exception_handler(RobotThereError, _in_the_way)
    app.add_exception_handler(Exception, _internal)


def _http(_: Request, error: Any) -> JSONResponse:
    return problem(error.status_code, str(error.detail), error.headers)


def _invalid(_: Request, error: Any) -> JSONResponse:
    mistake = error.errors()[0]
    place = ".".join(str(part) for part in mistake["loc"][1:])
    reason = mistake["msg"].removeprefix("Value error, ")
    return problem(422, f"{place}: {reason}" if place else reason)


def _no_history(_: Request, error: Any) -> JSONResponse:
    return problem(503, f"the history cannot be read: {error}", {"Retry-After": str(RETRY_S)})


def _not_found(_: Request, error: Any) -> JSONResponse:
    return problem(404, str(error))


def _in_the_way(_: Request, error: Any) -> JSONResponse:
    return problem(409, str(error))


def _internal(_: Request, __: Any) -> JSONResponse:
    return problem(500, "internal error; the monitor's log says more")
