"""Tables whose rows are loaded in windows, and choices in the address."""

import asyncio
from collections.abc import AsyncIterator
from functools import partial

import pytest
from nicegui import Client, core, events, ui

from services.monitor.web.pages.live_table import ROWS, Column, LiveTable, Loaded, RowWindow, address

COUNT = 3 * ROWS


class Shown:
    """A table of numbers beside a label. text: what is looked for. held: what each load waits for, the first first."""

    def __init__(self) -> None:
        self.text = ""
        self.label = ""
        self.count = COUNT
        self.held: list[asyncio.Future[None]] = []
        self.live = LiveTable([Column("id", "Number")], self._load, row_key="id", sort="id", body="", card="")

    async def _load(self, window: RowWindow) -> Loaded:
        text, count = self.text, self.count
        if self.held:
            await self.held.pop(0)
        numbers = sorted(range(count), reverse=window.descending)[window.begin : window.end]
        return Loaded([{"id": f"{text}{number}"} for number in numbers], count, partial(self._tell, text))

    def _tell(self, text: str) -> None:
        self.label = text

    @property
    def first(self) -> str:
        return str(self.live.table.rows[0]["id"])

    async def turn(self, page: int, *, descending: bool = False, size: int = ROWS, sort: str = "id") -> None:
        """Do what somebody does who turns to a page."""
        asked = {"page": page, "rowsPerPage": size, "sortBy": sort, "descending": descending}
        table = self.live.table
        await self.live._turn(
            events.GenericEventArguments(sender=table, client=table.client, args={"pagination": asked})
        )

    async def look_for(self, text: str) -> None:
        """Do what somebody does who types into the field above."""
        self.text = text
        await self.live.begin()


@pytest.fixture
async def shown(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Shown]:
    monkeypatch.setattr(core, "loop", asyncio.get_running_loop())  # else what a client begins waits for the next server
    with Client(ui.page("/")) as client:
        made = Shown()
    yield made
    client.delete()


async def test_only_the_rows_that_are_looked_at_are_sent(shown: Shown) -> None:
    await shown.live.refresh()
    assert (shown.first, len(shown.live.table.rows)) == ("0", ROWS)
    await shown.turn(3, descending=True)
    assert (shown.first, shown.live.table.pagination["rowsNumber"]) == (f"{ROWS - 1}", COUNT)


async def test_what_a_browser_may_not_ask_for_is_not_taken(shown: Shown) -> None:
    await shown.turn(-1, size=1_000_000, sort="no such")
    assert (shown.first, len(shown.live.table.rows)) == ("0", ROWS)
    assert shown.live.table.pagination["sortBy"] is None


async def test_whoever_looks_at_a_page_that_is_gone_is_shown_the_last_one(shown: Shown) -> None:
    await shown.turn(3)
    shown.count = ROWS + 1
    await shown.live.refresh()
    assert (shown.first, shown.live.table.pagination["page"]) == (f"{ROWS}", 2)
    shown.count = 0
    await shown.live.refresh()
    assert (shown.live.table.rows, shown.live.table.visible) == ([], False)


async def test_a_refresh_that_is_late_does_not_write_over_the_page_that_was_turned_to(shown: Shown) -> None:
    slow = asyncio.get_running_loop().create_future()
    shown.held = [slow]
    late = asyncio.create_task(shown.live.refresh())
    await asyncio.sleep(0)
    await shown.turn(2)
    assert shown.first == f"{ROWS}"
    slow.set_result(None)
    await late
    assert (shown.first, shown.live.table.pagination["page"]) == (f"{ROWS}", 2)


async def test_a_search_that_is_late_writes_over_nothing_that_another_one_found(shown: Shown) -> None:
    slow = asyncio.get_running_loop().create_future()
    shown.held = [slow]
    late = asyncio.create_task(shown.look_for("b"))
    await asyncio.sleep(0)
    await shown.look_for("box")
    slow.set_result(None)
    await late
    assert (shown.label, shown.first) == ("box", "box0")


def test_an_address_has_what_was_chosen_and_nothing_else() -> None:
    assert address({"search": "r 1&x=<b>", "state": ""}) == "?search=r+1%26x%3D%3Cb%3E"
    assert address({"search": ""}) == "?"
