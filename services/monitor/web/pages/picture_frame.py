"""Live pages of one camera: their visibility in the browser, and the stage that shows content or a reason."""

import asyncio
from pathlib import Path
from typing import Final

from nicegui import ui

from schemas.errors import SchemaError
from schemas.keys import CameraKey
from services.monitor.live_views.why_no_picture import Reason
from services.monitor.web.pages.frame import nothing_yet

VIEW_STYLE: Final = (Path(__file__).parent / "view.css").read_text(encoding="utf-8")


def camera_key(robot: str, camera: str) -> CameraKey | None:
    """Return the camera of an address; if its name is invalid, show that and return None."""
    try:
        return CameraKey(robot, camera)
    except SchemaError as error:
        nothing_yet("videocam_off", "There is no such camera", str(error))
        return None


class PictureFrame:
    """A dark area that shows its content, or a reason why there is none. Content is made inside `filling`."""

    def __init__(self) -> None:
        self._stage = ui.element("div").classes("fs-stage")
        with self._stage, ui.element("div").classes("fs-reason").props('role="status"') as self._reason:
            with ui.element("strong"):
                self._title = ui.label()
            self._age = ui.label().classes("fs-age")
            self._advice = ui.label()
        self.explain(None)

    def filling(self) -> ui.element:
        """Return the container for the content."""
        return self._stage

    def explain(self, reason: Reason | None, age: str = "") -> None:
        """Show why there is no content, or none newer than the given age; None: all is well."""
        self._reason.set_visibility(reason is not None)
        if reason is not None:
            self._title.set_text(reason.title)
            self._advice.set_text(reason.advice)
            self._age.set_text(age)
            self._age.set_visibility(bool(age))
            self._reason.classes(**{"add" if age else "remove": "fs-below"})


EVENT: Final = "fs-looks"
TELL: Final = f"""
document.addEventListener('visibilitychange', () => emitEvent('{EVENT}', !document.hidden));
emitEvent('{EVENT}', !document.hidden);
"""


class PageVisibility:
    """Tracks the visibility of one page; create it while the page is built."""

    def __init__(self) -> None:
        self._client = ui.context.client
        self._looks = True
        self._changed = asyncio.Event()
        ui.on(EVENT, lambda event: self._take(bool(event.args)))
        ui.run_javascript(TELL)
        self._client.on_delete(self._changed.set)

    @property
    def looks(self) -> bool:
        """Whether the page is visible now."""
        return self._looks and not self.is_over

    @property
    def is_over(self) -> bool:
        """Whether the page was closed."""
        return self._client.is_deleted

    async def begins(self) -> bool:
        """Wait until the page is visible; return False once it is closed."""
        await self._client.connected()
        while not (self.looks or self.is_over):
            await self._change()
        return not self.is_over

    async def ends(self, within_s: float | None = None) -> bool:
        """Wait until the page is hidden, up to a timeout; return whether it is."""
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
