"""A page's choices, kept in its address: they survive a reload, a restart of the monitor and a new log-in."""

import json
from collections.abc import Mapping
from typing import Final
from urllib.parse import urlencode

from nicegui import ui

from services.monitor.page.live_table import MAX_TEXT

SEARCH: Final = "search"


class Choices:
    """The choices on one browser's page; create it while the page is built. Each is text, empty for none."""

    def __init__(self) -> None:
        given = ui.context.client.request.query_params
        self._chosen = {name: value[:MAX_TEXT] for name, value in given.items()}

    def __getitem__(self, name: str) -> str:
        """Return a choice."""
        return self._chosen.get(name, "")

    def keep(self, name: str, value: str) -> None:
        """Store a choice, and update the browser's address."""
        self._chosen[name] = value
        ui.run_javascript(f"history.replaceState(history.state, '', {json.dumps(address(self._chosen))})")


def address(chosen: Mapping[str, str]) -> str:
    """Return the relative address of a page with these choices."""
    query = urlencode({name: value for name, value in chosen.items() if value})
    return f"?{query}" if query else "?"
