"""The pages that each visitor has open: bounded, since the server keeps every one of them in memory."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Final, Protocol

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
