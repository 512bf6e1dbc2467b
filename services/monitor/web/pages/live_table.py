"""Tables whose rows are loaded in windows, and the choices that a page keeps in its address."""

import json
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final
from urllib.parse import urlencode

from nicegui import events, ui

from services.monitor.event_loop.cooperative_yielding import pause

ROWS: Final = 25
CHOICES: Final = (10, 25, 50, 100)
MAX_TEXT: Final = 100

Rows = list[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Column:
    """A column. name: its sort key, if it is sortable."""

    name: str
    label: str
    sortable: bool = True
    align: str = "left"


@dataclass(frozen=True, slots=True)
class RowWindow:
    """The visible part of a table."""

    sort: str
    descending: bool
    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class Loaded:
    """The rows of a window, and the number of all rows. tell: shows beside the table how many were found."""

    rows: Rows
    count: int
    tell: Callable[[], object]


Load = Callable[[RowWindow], Awaitable[Loaded]]
"""Returns the rows of a window without side effects: by then another window, or other rows, may be wanted."""


class _Table(ui.table, component="live_table.js"):
    """The table element in the browser; see the JavaScript file of the same name."""


class LiveTable:
    """A table that calls `load` for its rows on `refresh`, on sorting and on turning pages.

    body, card: Vue templates of a row (`props.row`) and of what it is on a phone; `{{ }}` shows text as text.
    """

    def __init__(self, columns: Sequence[Column], load: Load, *, row_key: str, sort: str, body: str, card: str) -> None:
        self._load = load
        self._row_key = row_key
        self._begun = 0
        self._columns = columns
        self._sortable = {column.name for column in columns if column.sortable}
        self._pagination: dict[str, Any] = {
            "page": 1,
            "rowsPerPage": ROWS,
            "rowsNumber": 0,
            "sortBy": sort,
            "descending": False,
        }
        self.table = _Table(
            columns=self._headings(),
            rows=[],
            row_key=row_key,
            pagination=dict(self._pagination),
        ).classes("fs-table")
        self.table.props('flat dense binary-state-sort hide-no-data :grid="Quasar.Screen.width < 900"')
        self.table.props["body"], self.table.props["card"], self.table.props["sizes"] = body, card, CHOICES
        self.table.on("request", self._turn, [["pagination"]])
        self.table.on("size", self._resize)

    async def refresh(self) -> None:
        """Show the current rows, unless a newer call begins meanwhile: that one knows the current window."""
        self._begun += 1
        begun = self._begun
        size, page = self._pagination["rowsPerPage"], self._pagination["page"]
        sort, descending = self._pagination["sortBy"] or "", self._pagination["descending"]
        loaded = await self._load(RowWindow(sort, descending, (page - 1) * size, page * size))
        await pause()
        if begun != self._begun:
            return None
        rows, count = loaded.rows, loaded.count
        if not rows and page > 1:
            self._pagination["page"] = max(1, -(-count // size))
            return await self.refresh()
        loaded.tell()
        self._pagination["rowsNumber"] = count
        self.table.set_visibility(count > 0)
        if rows != self.table.rows or self._pagination != self.table.pagination:
            with self.table:
                self.table.props["pagination"] = dict(self._pagination)
                if (headings := self._headings()) != self.table.columns:
                    self.table.columns = headings
                self.table.rows = rows
        return None

    def _headings(self) -> list[dict[str, Any]]:
        """Return the columns as the table takes them; order: how it is sorted by one, in words of ARIA."""
        order = "descending" if self._pagination["descending"] else "ascending"
        return [
            {
                **asdict(column),
                "field": self._row_key,  # templates look up what they show
                "order": order if column.name == self._pagination["sortBy"] else "",
            }
            for column in self._columns
        ]

    async def begin(self) -> None:
        """Return to the first page."""
        self._pagination["page"] = 1
        await self.refresh()

    async def _resize(self, event: events.GenericEventArguments) -> None:
        size = int(event.args)
        self._pagination["rowsPerPage"] = size if size in CHOICES else ROWS
        await self.begin()

    async def _turn(self, event: events.GenericEventArguments) -> None:
        asked = event.args["pagination"]
        size, sort = int(asked["rowsPerPage"]), str(asked.get("sortBy"))
        self._pagination |= {
            "page": max(1, int(asked["page"])),
            "rowsPerPage": size if size in CHOICES else ROWS,
            "sortBy": sort if sort in self._sortable else None,
            "descending": bool(asked.get("descending")),
        }
        await self.refresh()


def search_field(placeholder: str, look_for: Callable[[str], Awaitable[None]], text: str = "") -> None:
    """Add a table's search field. look_for: called with the typed text. text: the initial text."""

    async def changed(event: events.ValueChangeEventArguments[str | None]) -> None:
        await look_for((event.value or "")[:MAX_TEXT])

    field = ui.input(placeholder=placeholder, value=text, on_change=changed)
    field.props('outlined dense clearable debounce=250 aria-label="Search"').classes("fs-search")


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
