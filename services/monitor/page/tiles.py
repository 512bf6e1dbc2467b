"""A figure that one should see at a glance, and that may be a button."""

from collections.abc import Callable
from typing import Any

from nicegui import ui


class Tile:
    """A figure with what it counts. dot: the state whose mark is beside it."""

    def __init__(self, what: str, *, dot: str = "", on_click: Callable[[], Any] | None = None) -> None:
        self._tile = ui.element("button" if on_click else "div").classes("fs-tile")
        if on_click:
            self._tile.on("click", lambda _: on_click()).props("type=button")
        with self._tile:
            with ui.element("div").classes("fs-what"):
                if dot:
                    ui.element("span").classes(f"fs-dot fs-{dot}")
                ui.label(what)
            with ui.element("div").classes("fs-number"):
                self._number = ui.label()
                self._of = ui.label().classes("fs-of")
        self._color = ""

    def show(self, number: str, of: str = "", *, on: bool = False) -> None:
        """Show a figure; on: it is what the page is about now."""
        self._number.set_text(number)
        self._of.set_text(of)
        self._tile.classes(add="fs-on" if on else "", remove="" if on else "fs-on")

    def color(self, name: str) -> None:
        """Mark it, or no longer, if the name is empty."""
        if name != self._color:
            self._tile.classes(add=name, remove=self._color)
            self._color = name
