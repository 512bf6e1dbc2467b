"""What is asked with another method than it is answered to: HEAD goes as GET does, others are refused."""

from collections.abc import Sequence
from typing import Final

from fastapi import HTTPException
from starlette.routing import BaseRoute, Match
from starlette.types import Receive, Scope, Send

METHODS: Final = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE")


class OtherMethods(BaseRoute):
    """Is to come after some routes, and before those that take every path."""

    def __init__(self, routes: Sequence[BaseRoute]) -> None:
        self._routes = tuple(routes)

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Match a path that one of the routes answers to some other method."""
        is_there = any(route.matches(scope)[0] is Match.PARTIAL for route in self._routes)
        return (Match.FULL if is_there else Match.NONE), {}

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer; the server leaves out the body of what answers HEAD, which it knows by a scope of its own.

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
