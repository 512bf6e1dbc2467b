"""What is answered instead of a page: what is wrong, and what to do. Pure."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Final, Protocol

from fastapi import FastAPI, Request
from fastapi.responses import HTMLResponse

from services.monitor.web.auth.forms import notice

MOST_OPEN: Final = 50
"""Pages that one visitor has at once."""

MOST_LEFT: Final = 10
"""Of them those that no browser is connected to: what was fetched and never opened would else be kept for a minute."""


class Client(Protocol):
    """A page in a browser, as the page's library has it."""

    @property
    def has_socket_connection(self) -> bool:
        """Whether a browser shows it."""

    @property
    def is_deleted(self) -> bool:
        """Whether it is over."""

    def delete(self) -> None:
        """End it."""


@dataclass(slots=True, eq=False)
class Visit:
    """One page. made: whether it is whole, so that it may be given up."""

    client: Client
    made: bool = False


class Visits:
    """Every page that was sent and is not over, by visitor."""

    def __init__(self) -> None:
        self._of = defaultdict[str, list[Visit]](list)

    def make_room(self, name: str) -> bool:
        """Give up what a visitor left; return whether they may have one more page."""
        here = [visit for visit in self._of.pop(name, ()) if not visit.client.is_deleted]
        left = [visit for visit in here if visit.made and not visit.client.has_socket_connection]
        for visit in left[: max(0, len(left) - MOST_LEFT + 1)]:
            visit.client.delete()
            here.remove(visit)
        if here:
            self._of[name] = here
        return len(here) < MOST_OPEN

    def begin(self, name: str, client: Client) -> Visit:
        """Note that a visitor gets a page."""
        visit = Visit(client)
        self._of[name].append(visit)
        return visit


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
