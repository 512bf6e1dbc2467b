"""Work that is done only while somebody wants what comes of it."""

import asyncio
from collections.abc import Callable, Coroutine


class SharedDemand:
    """Whether any of several publishers is wanted. To be used on the event loop's thread."""

    def __init__(self) -> None:
        self._wanted: set[str] = set()
        self._on = asyncio.Event()
        self._off = asyncio.Event()
        self._off.set()

    def of(self, publisher: str) -> Callable[[bool], None]:
        """Return the `on_demand` callback of one publisher."""

        def update(wanted: bool) -> None:  # noqa: FBT001 - the bus calls it so
            (self._wanted.add if wanted else self._wanted.discard)(publisher)
            (self._on.set if self._wanted else self._on.clear)()
            (self._off.clear if self._wanted else self._off.set)()

        return update

    @property
    def wanted(self) -> bool:
        """Whether any of the publishers is wanted now."""
        return bool(self._wanted)

    async def until(self, *, wanted: bool) -> None:
        """Wait until any of the publishers is wanted, or until none is."""
        await (self._on if wanted else self._off).wait()


async def while_wanted(
    demand: SharedDemand, work: Callable[[], Coroutine[None, None, None]], *, linger_s: float = 0.0
) -> None:
    """Run `work` whenever there is demand, for ever; cancel it when there was none for `linger_s` seconds on end.

    For work that takes long to begin: it lives on through a demand that blinks.
    """
    while True:
        await demand.until(wanted=True)
        async with asyncio.TaskGroup() as group:
            working = group.create_task(work())
            await _none_for(demand, linger_s)
            working.cancel()


async def _none_for(demand: SharedDemand, linger_s: float) -> None:
    while True:
        await demand.until(wanted=False)
        try:
            async with asyncio.timeout(linger_s):
                await demand.until(wanted=True)
        except TimeoutError:
            return
