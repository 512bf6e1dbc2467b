"""Limits the pages that a visitor has open, and answers with an error page over the limit. Pure."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Final, Protocol

from fastapi import FastAPI, Request
from fastapi.responses import HTMLResponse

from services.monitor.web.auth.routes import notice

MOST_OPEN: Final = 50
"""Maximum number of pages per visitor."""

MOST_LEFT: Final = 10
"""Maximum of these without a browser connection: pages fetched but never opened would be kept for a minute."""


class Client(Protocol):
    """A page in a browser, as the page's library represents it."""

    @property
    def has_socket_connection(self) -> bool:
        """Whether a browser is connected."""

    @property
    def is_deleted(self) -> bool:
        """Whether the page is closed."""

    def delete(self) -> None:
        """Close the page."""


@dataclass(slots=True, eq=False)
class Visit:
    """One page. made: it is complete, so that it may be closed."""

    client: Client
    made: bool = False


class Visits:
    """All pages that were sent and are not closed, by visitor."""

    def __init__(self) -> None:
        self._of = defaultdict[str, list[Visit]](list)

    def make_room(self, name: str) -> bool:
        """Close a visitor's abandoned pages; return whether one more page is allowed."""
        here = [visit for visit in self._of.pop(name, ()) if not visit.client.is_deleted]
        left = [visit for visit in here if visit.made and not visit.client.has_socket_connection]
        for visit in left[: max(0, len(left) - MOST_LEFT + 1)]:
            visit.client.delete()
            here.remove(visit)
        if here:
            self._of[name] = here
        return len(here) < MOST_OPEN

    def begin(self, name: str, client: Client) -> Visit:
        """Note that a page is made for a visitor."""
        visit = Visit(client)
        self._of[name].append(visit)
        return visit


class TooManyPagesError(Exception):
    """A visitor has the maximum number of pages open."""


def answer_instead(pages: FastAPI) -> None:
    """Register error pages with the pages' application."""
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
