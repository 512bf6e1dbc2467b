"""Whether somebody looks at a page: it is open in a browser, and not in a tab behind others."""

import asyncio
from typing import Final

from nicegui import ui

EVENT: Final = "fs-looks"
TELL: Final = f"""
document.addEventListener('visibilitychange', () => emitEvent('{EVENT}', !document.hidden));
emitEvent('{EVENT}', !document.hidden);
"""


class PageVisibility:
    """Follows one page; to be made while the page is built."""

    def __init__(self) -> None:
        self._client = ui.context.client
        self._looks = True
        self._changed = asyncio.Event()
        ui.on(EVENT, lambda event: self._take(bool(event.args)))
        ui.run_javascript(TELL)
        self._client.on_delete(self._changed.set)

    @property
    def looks(self) -> bool:
        """Whether somebody looks now."""
        return self._looks and not self.is_over

    @property
    def is_over(self) -> bool:
        """Whether the page was closed."""
        return self._client.is_deleted

    async def begins(self) -> bool:
        """Wait until somebody looks; return False once the page is closed."""
        await self._client.connected()
        while not (self.looks or self.is_over):
            await self._change()
        return not self.is_over

    async def ends(self, within_s: float | None = None) -> bool:
        """Wait until nobody looks, for so long at most; return whether that is so."""
        try:
            async with asyncio.timeout(within_s):
                while self.looks:
                    await self._change()
        except TimeoutError:
            return False
        return True

    def _take(self, looks: bool) -> None:  # noqa: FBT001 - as the browser says it
        self._looks = looks
        self._changed.set()

    async def _change(self) -> None:
        self._changed.clear()
        await self._changed.wait()
