"""Parameters of a URL that a route does not read: refused, or a misspelt filter would answer with everything."""

from collections.abc import Iterator, Sequence
from typing import Final, get_origin

from fastapi import HTTPException
from fastapi.dependencies.models import Dependant
from starlette.requests import HTTPConnection

MAX_SHOWN: Final = 80


async def refuse_unknown(connection: HTTPConnection) -> None:
    """Be a dependency of every route.

    Raises:
        HTTPException: there is a parameter that the route does not have, or twice one of which it reads the last alone.
    """
    known = dict(_parameters(connection.scope["route"].dependant))
    given = connection.query_params
    for name in given:
        reason = ""
        if name not in known:
            there = f"there are {', '.join(sorted(known))}" if known else "there are none here"
            reason = f"{name[:MAX_SHOWN]!r} is not a parameter: {there}"
        elif len(given.getlist(name)) > 1 and not known[name]:
            reason = f"{name!r} is given more than once"
        if reason:
            raise HTTPException(422, reason)


def _parameters(of: Dependant) -> Iterator[tuple[str, bool]]:
    """Yield each parameter's name, and whether it may be there several times."""
    for parameter in of.query_params:
        yield parameter.alias, get_origin(parameter.field_info.annotation) is Sequence
    for each in of.dependencies:
        yield from _parameters(each)
