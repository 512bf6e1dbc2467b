"""Log-in, log-out and set-up of the first user: routes and their plain HTML forms."""

from dataclasses import dataclass
from html import escape
from typing import Final
from urllib.parse import parse_qsl

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from services.monitor.web.auth.gate import LOG_IN, LOG_OUT, SET_UP, local_path
from services.monitor.web.auth.logins import Access, AccessError
from services.monitor.web.auth.middleware import FORM_POLICY
from services.monitor.web.auth.passwords import MAX_LENGTH, MIN_LENGTH

STYLE: Final = """
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; --back: #f4f5f7; --card: #fff; --ink: #1b1f23;
  --faint: #57606a; --line: #8a929a; --wrong: #fde8e6; }
@media (prefers-color-scheme: dark) {
  :root { --back: #14171a; --card: #1e2226; --ink: #e6e8ea; --faint: #a5adb5; --line: #5b646d; --wrong: #4a1d1a; }
}
body { margin: 0; min-height: 100vh; display: grid; place-items: center; background: var(--back); color: var(--ink); }
main { box-sizing: border-box; width: min(24rem, 100vw); padding: 2rem; border-radius: .75rem;
  background: var(--card); }
h1 { margin: 0 0 1rem; font-size: 1.25rem; }
label { display: block; margin-top: 1rem; }
input, button { box-sizing: border-box; width: 100%; min-height: 2.75rem; margin-top: .25rem; padding: 0 .75rem;
  font: inherit; border: 1px solid var(--line); border-radius: .375rem; background: var(--card); color: var(--ink); }
button { margin-top: 1.5rem; border: 0; background: #1264a3; color: #fff; cursor: pointer; }
:focus-visible { outline: 3px solid #4c9be0; outline-offset: 2px; }
.wrong { margin: 0; padding: .5rem .75rem; border-radius: .375rem; background: var(--wrong); }
.hint { font-size: .875rem; color: var(--faint); }
"""


def log_in_form(after: str, wrong: str = "") -> str:
    """Return the log-in form. after: where to go then. wrong: the error."""
    return _page(
        "Log in",
        wrong,
        f"""<form method="post" action="{LOG_IN}">
<input type="hidden" name="next" value="{escape(after)}">
<label>Name<input name="name" autocomplete="username" autocapitalize="none" maxlength="64" required autofocus></label>
<label>Password<input name="password" type="password" autocomplete="current-password" maxlength="{MAX_LENGTH}"
  required></label>
<button>Log in</button>
</form>""",
    )


def set_up_form(secret: str, wrong: str = "") -> str:
    """Return the form for the first user. secret: from the link."""
    return _page(
        "Set up fleetsight",
        wrong,
        f"""<p>Nobody can log in yet. Make the first user, an operator: one who may acknowledge and resolve alerts.</p>
<form method="post" action="{SET_UP}">
<input type="hidden" name="token" value="{escape(secret)}">
<label>Name<input name="name" autocomplete="username" autocapitalize="none" maxlength="64" required autofocus></label>
<label>Password<input name="password" type="password" autocomplete="new-password" minlength="{MIN_LENGTH}"
  maxlength="{MAX_LENGTH}" required></label>
<label>Password again<input name="again" type="password" autocomplete="new-password" maxlength="{MAX_LENGTH}"
  required></label>
<p class="hint">{MIN_LENGTH} characters or more. Others are added with: fleetsight users add NAME --role viewer</p>
<button>Make this user</button>
</form>""",
    )


def link_needed() -> str:
    """Return the page for visitors without the set-up link, before there is a user."""
    return _page(
        "Set up fleetsight",
        "",
        "<p>Nobody can log in yet. The monitor shows a link for the first user: on its terminal and in its log.</p>",
    )


def notice(title: str, text: str) -> str:
    """Return a page that shows a message instead of the requested page."""
    return _page(title, "", f'<p>{escape(text)}</p><p><a href="/">To the fleet</a></p>')


def _page(title: str, wrong: str, content: str) -> str:
    said = f'<p class="wrong" role="alert">{escape(wrong)}</p>' if wrong else ""
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>{STYLE}</style>
</head>
<body><main><h1>{escape(title)}</h1>{said}{content}</main></body>
</html>
"""


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
