"""A figure that one should see at a glance, and that may be a button."""

from collections.abc import Callable
from html import escape
from typing import Any

from nicegui import ui


class Tile:
    """A figure with what it counts: one element, of which a page has many. dot: the state whose mark is beside it."""

    def __init__(self, what: str, *, dot: str = "", on_click: Callable[[], Any] | None = None) -> None:
        mark = f'<span class="fs-dot fs-{dot}"></span>' if dot else ""
        self._what = f'<div class="fs-what">{mark}<div>{escape(what)}</div></div>'
        self._tile = ui.html(self._what, sanitize=False, tag="button" if on_click else "div").classes("fs-tile")
        if on_click:
            self._tile.on("click", lambda _: on_click()).props("type=button")
        self._color = ""

    def show(self, number: str, of: str = "", *, on: bool = False) -> None:
        """Show a figure; on: it is what the page is about now."""
        of_how_many = f'<div class="fs-of">{escape(of)}</div>' if of else ""
        self._tile.set_content(f'{self._what}<div class="fs-number"><div>{escape(number)}</div>{of_how_many}</div>')
        self._tile.classes(add="fs-on" if on else "", remove="" if on else "fs-on")

    def color(self, name: str) -> None:
        """Mark it, or no longer, if the name is empty."""
        if name != self._color:
            self._tile.classes(add=name, remove=self._color)
            self._color = name
