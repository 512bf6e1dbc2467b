"""A question before something that cannot be taken back."""

from typing import Final

from nicegui import ui

YES: Final = "yes"


class Confirmation:
    """A dialog that asks whether somebody means it. do, leave: what its buttons say; advice: what comes of it."""

    def __init__(self, do: str, leave: str, advice: str) -> None:
        with ui.dialog() as self._dialog, ui.element("div").classes("fs-panel fs-question"):
            self._what = ui.label().classes("fs-title")
            ui.label(advice).classes("fs-muted")
            with ui.element("div").classes("fs-answers"):
                ui.button(leave, on_click=lambda: self._dialog.submit("")).props("flat no-caps autofocus")
                ui.button(do, on_click=lambda: self._dialog.submit(YES)).props(
                    "unelevated no-caps text-color=on-accent"
                )

    async def given(self, what: str) -> bool:
        """Ask; return whether somebody means it, which who closes it does not."""
        self._what.set_text(what)
        self._dialog.props["aria-label"] = what
        self._dialog.update()
        return bool(await self._dialog == YES)
