"""Presence: which robots, cameras and workers are there, and which come and go."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import AbstractAsyncContextManager, aclosing
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from bus import BusClosedError, Presence, Watch
from fleetsight.arguments import time_s
from fleetsight.errors import ClosedError, no_link
from fleetsight.streams import Iterations
from schemas.errors import SchemaError

SETTLE_S: Final = 0.5
"""After so long without news all of them are known."""

PRESENT_TIMEOUT_S: Final = 5.0
"""So long at most for all to be known, where some come and go all the time."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Change(Generic[T]):
    """Somebody is there now, or is there no longer.

    >>> fleetsight.Change("r1", here=True)
    Change(who='r1', here=True)
    """

    who: T
    here: bool


@dataclass(frozen=True, slots=True, order=True)
class WorkerName:
    """One worker. service: what it does, such as `detector`, `distance` or `cloud`.

    >>> fleetsight.WorkerName("detector", "w1").service
    'detector'
    """

    service: str
    worker: str


class Roster(Generic[T]):
    """The robots, the cameras or the workers that are there. Watching makes nobody work.

    Each `async for` begins with those that are there already, and ends when the fleet is left. Changes that the program
    has not taken yet are merged: nobody is reported here, or gone, twice in a row.

    >>> async def main():
    ...     async with fleetsight.connect(endpoint) as fleet:
    ...         async for change in fleet.robots():
    ...             return change
    >>> asyncio.run(main())
    Change(who='r1', here=True)
    """

    def __init__(
        self,
        iterations: Iterations,
        what: str,
        watch: Callable[[], AbstractAsyncContextManager[Watch]],
        parse: Callable[[str], T],
        link_problem: Callable[[], str],
    ) -> None:
        self._iterations = iterations
        self._what = what
        self._watch = watch
        self._parse = parse
        self._link_problem = link_problem

    def __aiter__(self) -> AsyncGenerator[Change[T], None]:  # noqa: PYI058 - it can be closed
        """Iterate over those that come and go.

        Raises:
            ClosedError: the fleet was left before.
        """
        return self._iterations.add(self._iterate())

    async def _iterate(self) -> AsyncGenerator[Change[T], None]:
        tokens: dict[T, set[str]] = {}  # a worker that is for several robots has one for each
        with self._iterations.running():
            try:
                async with self._watch() as watch:
                    async for presence in watch:
                        change = self._change(presence, tokens)
                        if change is not None:
                            yield change
            except BusClosedError as error:
                raise self._left() from error

    def _change(self, presence: Presence, tokens: dict[T, set[str]]) -> Change[T] | None:
        try:
            who = self._parse(presence.key)
        except SchemaError:  # not of this fleet
            return None
        shown = tokens.setdefault(who, set())
        before = bool(shown)
        (shown.add if presence.alive else shown.discard)(presence.key)
        if not shown:
            del tokens[who]
        return Change(who, here=bool(shown)) if before != bool(shown) else None

    def _left(self) -> ClosedError:
        return ClosedError(f"{self._what}: the fleet was left before; ask within `async with`")

    async def present(self, *, settle_s: float = SETTLE_S, within_s: float = PRESENT_TIMEOUT_S) -> frozenset[T]:
        """Return those that are there now: all that were heard of until nothing new came for `settle_s` seconds.

        Where somebody comes or goes all the time, those that are there after `within_s` seconds.

        Raises:
            ConnectError: there is no link, so nobody knows.
            ClosedError: the fleet was left before.
            SettingsError: a time that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         return await fleet.cameras().present()
        >>> sorted(map(str, asyncio.run(main())))
        ['r1/front']
        """
        settle_s, within_s = time_s("settle_s", settle_s), time_s("within_s", within_s)
        here: set[T] = set()
        loop = asyncio.get_running_loop()
        until_s = loop.time() + within_s
        problem = self._link_problem()
        try:
            async with asyncio.timeout(min(settle_s, within_s)) as limit, aclosing(aiter(self)) as changes:
                async for change in changes:
                    (here.add if change.here else here.discard)(change.who)
                    limit.reschedule(min(until_s, loop.time() + settle_s))
        except TimeoutError:
            if problem := problem or self._link_problem():
                raise no_link(self._what, problem) from None
            return frozenset(here)
        raise self._left()
