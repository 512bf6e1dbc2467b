"""Who asks: what routes and pages need to know of whoever a request comes from."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from starlette.requests import HTTPConnection

STATE: Final = "fleetsight.visitor"
"""Where the access middleware puts the visitor in a request's scope."""


class Role(StrEnum):
    """What a user may do: look, or act too."""

    VIEWER = "viewer"
    OPERATOR = "operator"


@dataclass(frozen=True, slots=True)
class Visitor:
    """A user who is logged in. What they may do is asked anew each time: roles change and sessions end meanwhile."""

    name: str
    _role: Callable[[], Role | None] = field(repr=False)
    _use: Callable[[], None] = field(repr=False, default=lambda: None)

    @property
    def role(self) -> Role | None:
        """Their role now; None once they are logged out or no user any more."""
        return self._role()

    def stay(self) -> None:
        """Have their session go on though they ask for nothing, as before a screen that shows everything by itself."""
        self._use()

    @property
    def may_look(self) -> bool:
        """Whether they may still see anything."""
        return self.role is not None

    @property
    def may_act(self) -> bool:
        """Whether they may do something about alerts and robots."""
        return self.role is Role.OPERATOR


def visitor_of(request: HTTPConnection) -> Visitor:
    """Return who a request, or a WebSocket, comes from; to be used where the access middleware let it through."""
    visitor = request.scope[STATE]
    assert isinstance(visitor, Visitor), "only the middleware puts something there"  # noqa: S101 - for the type
    return visitor
