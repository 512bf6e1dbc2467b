"""Pages of long lists, and the cursors between them."""

import base64
import binascii
import json
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Annotated, Any, Final, TypeVar, get_origin

from fastapi import HTTPException, Query, Request
from fastapi.dependencies.models import Dependant
from starlette.requests import HTTPConnection

from schemas.header import MAX_LABEL
from services.monitor.monitor import Monitor
from services.monitor.web.auth.users import visitor_of

T = TypeVar("T")

MAX_ITEMS: Final = 1_000
MAX_MARK: Final = 1_000
MAX_INTEGER: Final = 2**63

Limit = Annotated[int, Query(ge=1, le=MAX_ITEMS, description="maximum number of items")]
After = Annotated[str | None, Query(max_length=MAX_MARK, description="`next` of the previous page")]
Name = Annotated[str, Query(max_length=64, description="only this name")]
ClassName = Annotated[str, Query(alias="class", max_length=MAX_LABEL, description="only this class")]


def mark_of(place: Sequence[str | int]) -> str:
    """Return the cursor of a place in a list, as text for a URL."""
    return base64.urlsafe_b64encode(json.dumps(list(place), separators=(",", ":")).encode()).decode().rstrip("=")


def place_of(mark: str, kinds: Sequence[type[str | int]]) -> tuple[Any, ...]:
    """Return the place of a cursor.

    Raises:
        HTTPException: it is none of ours.
    """
    try:
        found = json.loads(base64.urlsafe_b64decode(mark + "=" * (-len(mark) % 4)))
    except (ValueError, binascii.Error, RecursionError):
        found = None
    fits = isinstance(found, list) and [type(each) for each in found] == list(kinds)
    if not fits or any(isinstance(each, int) and abs(each) >= MAX_INTEGER for each in found):
        raise HTTPException(422, "invalid `after`; use the `next` of the previous page")
    return tuple(found)


def page_of(
    every: Sequence[T],
    place: Callable[[T], tuple[str, ...]],
    limit: int,
    after: str | None,
    width: int,
    *,
    wanted: Callable[[T], bool] = lambda _: True,
) -> tuple[list[T], str | None]:
    """Return a page of a list sorted by `place`, a tuple of `width` texts, and the cursor of the next page."""
    begin = 0 if after is None else bisect_right(every, place_of(after, (str,) * width), key=place)
    found = list(islice((each for each in islice(every, begin, None) if wanted(each)), limit + 1))
    return first_of(found, place, limit)


def first_of(found: list[T], place: Callable[[T], Sequence[str | int]], limit: int) -> tuple[list[T], str | None]:
    """Return the first `limit` items, and the cursor of the next page if there are more."""
    return (found, None) if len(found) <= limit else (found[:limit], mark_of(place(found[limit - 1])))


MAX_SHOWN: Final = 80


async def refuse_unknown(connection: HTTPConnection) -> None:
    """Refuse unknown and repeated parameters; a dependency of every route.

    Raises:
        HTTPException: there is a parameter that the route does not have, or twice one of which it reads the last alone.
    """
    known = dict(_parameters(connection.scope["route"].dependant))
    given = connection.query_params
    for name in given:
        reason = ""
        if name not in known:
            there = f"known are {', '.join(sorted(known))}" if known else "none is known here"
            reason = f"unknown parameter {name[:MAX_SHOWN]!r}: {there}"
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


def operator_of(request: Request, monitor: Monitor) -> str:
    """Return the name of the operator who sends a request.

    Raises:
        HTTPException: it is none, or another monitor raises the alerts.
    """
    visitor = visitor_of(request)
    if not visitor.may_act:
        raise HTTPException(403, "only operators may do this")
    if not monitor.history.status.leads:
        raise HTTPException(409, "another monitor raises the alerts: ask that one")
    return visitor.name
