"""What is answered instead of a page: what is wrong, and what to do."""

from fastapi import FastAPI, Request
from fastapi.responses import HTMLResponse

from services.monitor.page.visits import MOST_OPEN
from services.monitor.web.auth.forms import notice


class TooManyPagesError(Exception):
    """A visitor has as many pages open as may be."""


def answer_instead(pages: FastAPI) -> None:
    """Have the pages' application answer its errors so."""
    pages.add_exception_handler(TooManyPagesError, _too_many)
    pages.add_exception_handler(404, _nothing_here)
    pages.add_exception_handler(Exception, _broken)


def _too_many(_: Request, __: Exception) -> HTMLResponse:
    text = f"You have {MOST_OPEN} pages of this monitor open. Close some of them, then load this one again."
    return HTMLResponse(notice("Too many pages are open", text), 503)


def _nothing_here(request: Request, _: Exception) -> HTMLResponse:
    return HTMLResponse(notice("There is no such page", f"The monitor has nothing at {request.url.path[:200]}."), 404)


def _broken(_: Request, __: Exception) -> HTMLResponse:
    text = "Load it again. If that does not help, the monitor's log says what is wrong; the API and alerts go on."
    return HTMLResponse(notice("This page could not be made", text), 500)
