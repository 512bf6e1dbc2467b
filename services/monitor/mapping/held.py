"""The robots that one map follows."""

from collections.abc import Iterable, Mapping
from contextlib import AsyncExitStack
from types import TracebackType
from typing import Self

from services.monitor.live_views.shared import CrowdedError
from services.monitor.mapping.following import Robots
from services.monitor.mapping.pose import Whereabouts


class HeldRobots:
    """Follows robots for as long as it is entered. crowded: why some are not followed, or empty."""

    def __init__(self, robots: Robots) -> None:
        self._robots = robots
        self._held: dict[str, tuple[AsyncExitStack, Whereabouts]] = {}
        self.crowded = ""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.keep(())

    async def keep(self, wanted: Iterable[str]) -> Mapping[str, Whereabouts]:
        """Follow these and no others; return where they are, as far as there is room to follow them."""
        names = list(wanted)
        for gone in self._held.keys() - set(names):
            stack, _ = self._held.pop(gone)
            await stack.aclose()
        self.crowded = ""
        for name in names:
            if name not in self._held:
                await self._hold(name)
        return {name: where for name, (_, where) in self._held.items()}

    async def _hold(self, name: str) -> None:
        async with AsyncExitStack() as stack:
            try:
                where = await stack.enter_async_context(self._robots.hold(name))
            except CrowdedError as error:
                self.crowded = str(error)
                return
            self._held[name] = stack.pop_all(), where
