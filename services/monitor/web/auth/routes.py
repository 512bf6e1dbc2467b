"""Log-in, log-out, and set-up of the first user."""

from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qsl

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from services.monitor.web.auth.forms import link_needed, log_in_form, set_up_form
from services.monitor.web.auth.gate import LOG_IN, LOG_OUT, SET_UP, local_path
from services.monitor.web.auth.logins import Access, AccessError
from services.monitor.web.auth.middleware import FORM_POLICY

MAX_FIELDS: Final = 8
COOKIE_S: Final = 365 * 86_400
"""Seconds for which a browser keeps its cookie; the session may end earlier."""


def access_routes(access: Access, *, cookie: str, secure: bool) -> APIRouter:
    """Return the routes. secure: browsers send the cookie over HTTPS only."""
    router = APIRouter(include_in_schema=False)
    _add_log_in(router, access, Cookie(cookie, secure))
    _add_set_up(router, access, Cookie(cookie, secure))
    return router


@dataclass(frozen=True, slots=True)
class Cookie:
    """The session cookie. secure: over HTTPS only."""

    name: str
    secure: bool

    def given(self, secret: str, to: str) -> Response:
        """Return a redirect that sets the cookie."""
        response = RedirectResponse(to, 303)
        response.set_cookie(self.name, secret, COOKIE_S, secure=self.secure, httponly=True, samesite="lax")
        return response

    def taken(self) -> Response:
        """Return a redirect that deletes the cookie."""
        response = RedirectResponse(LOG_IN, 303)
        response.delete_cookie(self.name, secure=self.secure, httponly=True, samesite="lax")
        return response


def _add_log_in(router: APIRouter, access: Access, cookie: Cookie) -> None:
    @router.get(LOG_IN)
    async def log_in_page(request: Request) -> Response:
        if access.needs_setup:
            return RedirectResponse(SET_UP, 303)
        return _form(log_in_form(local_path(request.query_params.get("next", "/"))))

    @router.post(LOG_IN)
    async def log_in(request: Request) -> Response:
        given = await _fields(request)
        after = local_path(given.get("next", "/"))
        try:
            secret = await access.log_in(given.get("name", ""), given.get("password", ""), _address(request))
        except AccessError as error:
            return _form(log_in_form(after, str(error)), error)
        access.log_out(request.cookies.get(cookie.name, ""))  # ends the browser's earlier session
        return cookie.given(secret, after)

    @router.post(LOG_OUT)
    async def log_out(request: Request) -> Response:
        access.log_out(request.cookies.get(cookie.name, ""))
        return cookie.taken()


def _add_set_up(router: APIRouter, access: Access, cookie: Cookie) -> None:
    @router.get(SET_UP)
    async def set_up_page(request: Request) -> Response:
        if not access.needs_setup:
            return RedirectResponse(LOG_IN, 303)
        secret = request.query_params.get("token", "")
        return _form(set_up_form(secret) if secret else link_needed())

    @router.post(SET_UP)
    async def set_up(request: Request) -> Response:
        given = await _fields(request)
        secret, password = given.get("token", ""), given.get("password", "")
        if password != given.get("again"):
            wrong = AccessError("the two passwords are not the same")
            return _form(set_up_form(secret, str(wrong)), wrong)
        try:
            session = await access.set_up(secret, given.get("name", ""), password, _address(request))
        except AccessError as error:
            return _form(set_up_form(secret, str(error)), error)
        return cookie.given(session, "/")


def _form(page: str, error: AccessError | None = None) -> Response:
    headers = {"Content-Security-Policy": FORM_POLICY}
    if error is None:
        return HTMLResponse(page, headers=headers)
    if error.wait_s:
        headers["Retry-After"] = str(round(error.wait_s + 0.5))
    return HTMLResponse(page, 429 if error.wait_s else 403, headers)


async def _fields(request: Request) -> dict[str, str]:
    try:
        return dict(parse_qsl((await request.body()).decode(), keep_blank_values=True, max_num_fields=MAX_FIELDS))
    except ValueError:  # not UTF-8, or more fields than there are
        return {}


def _address(request: Request) -> str:
    return request.client.host if request.client is not None else ""
