"""Parameters of a URL that a route does not read: refused, or a misspelt filter would answer with everything."""

from collections.abc import Iterator
from typing import Final

from fastapi import HTTPException, WebSocketException
from fastapi.dependencies.models import Dependant
from starlette.requests import HTTPConnection
from starlette.status import WS_1008_POLICY_VIOLATION

MAX_SHOWN: Final = 80


async def refuse_unknown(connection: HTTPConnection) -> None:
    """Be a dependency of every route.

    Raises:
        HTTPException: there is a parameter that the route does not have.
        WebSocketException: the same of a WebSocket's route.
    """
    known = sorted(_names(connection.scope["route"].dependant))
    for name in connection.query_params:
        if name not in known:
            there = f"there are {', '.join(known)}" if known else "there are none here"
            reason = f"{name[:MAX_SHOWN]!r} is not a parameter: {there}"
            if connection.scope["type"] == "websocket":
                raise WebSocketException(WS_1008_POLICY_VIOLATION, reason)
            raise HTTPException(422, reason)


def _names(of: Dependant) -> Iterator[str]:
    yield from (parameter.alias for parameter in of.query_params)
    for each in of.dependencies:
        yield from _names(each)
