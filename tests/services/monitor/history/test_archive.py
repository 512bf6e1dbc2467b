from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from schemas.alerts import AlertState
from schemas.keys import CameraKey
from services.monitor.history import archive as archive_module
from services.monitor.history.archive import Archive, HistoryQuery
from services.monitor.history.opening import connect
from services.monitor.history.settings import NONE
from services.monitor.history.state import Act, HistoryError
from services.monitor.inventory.inventory import Entry
from services.monitor.web.pages.rows.sightings import Filters, SightingTable
from tests.schemas.results import alert
from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.inventory.seeing import S

NOW_S = 1_700_000_000
"""Nanoseconds since the epoch need 64 bits."""


async def test_sightings_come_page_by_page_each_once_newest_first(url: str) -> None:
    some = [interval(NOW_S + second, NOW_S + second, name=name) for second in range(3) for name in ("box", "pallet")]
    async with opened(url) as store:
        await store.write(some, [], NOW_S * S)
    archive, found, after = Archive(url), [], None
    while page := await archive.sightings(HistoryQuery(), 4, after):
        found += page
        last = page[-1]
        after = (last.since_ns, last.key.robot, last.key.camera, last.name)
    assert found == some[::-1]


async def test_pages_of_a_long_history_are_those_of_all_of_it(url: str) -> None:
    some = []
    for number, (ago, long) in enumerate(product(range(14), repeat=2)):
        since_s = NOW_S - 3**ago
        key, name = CameraKey(f"r{number}", "front"), ("box", "pallet")[number % 2]
        some.append(interval(since_s, min(NOW_S, since_s + 3**long), key=key, name=name))
    async with opened(url) as store:
        await store.write(some, [], NOW_S * S)
    for asked, limit in ((HistoryQuery(), 50), (HistoryQuery((NOW_S - 9_000) * S, (NOW_S - 99) * S, name="box"), 13)):
        archive, found, after = Archive(url), [], None
        while page := await archive.sightings(asked, limit, after):
            found += page
            last = page[-1]
            after = (last.since_ns, last.key.robot, last.key.camera, last.name)
        wanted = [of for of in some if of.until_ns >= asked.since_ns and of.since_ns <= asked.until_ns]
        wanted = [of for of in wanted if asked.name in ("", of.name)]
        assert found == sorted(wanted, key=lambda of: (of.since_ns, of.key.robot), reverse=True)


async def test_the_newest_are_found_without_a_look_at_all_that_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, steps = f"sqlite:///{tmp_path}/history.db", []
    async with opened(url) as store:
        await store.write([interval(NOW_S - n, NOW_S - n) for n in range(5_000)], [], NOW_S * S)

    async def counting(engine: AsyncEngine, *, create: bool) -> AsyncConnection:
        connection = await connect(engine, create=create)
        database = (await connection.get_raw_connection()).driver_connection
        assert database is not None
        await database.set_progress_handler(lambda: steps.append(1), 1)
        return connection

    monkeypatch.setattr(archive_module, "connect", counting)
    assert len(await Archive(url).sightings(HistoryQuery(), 20)) == 20
    assert len(steps) < 5_000


async def test_what_is_searched_for_is_in_one_of_the_names_of_a_sighting_in_capitals_or_not(url: str) -> None:
    some = [interval(second, second, name=name) for second, name in enumerate(("Box", "big_box", "bigxbox"), 1)]
    async with opened(url) as store:
        await store.write(some, [], NOW_S * S)
    archive = Archive(url)
    for text, count in (("BOX", 3), ("g_b", 1), ("%", 0), (some[0].worker, 3), ("r1", 3), ("no such", 0)):
        assert len(await archive.sightings(HistoryQuery(text=text), 9)) == count, text


async def test_letters_of_every_alphabet_are_found_in_capitals_or_not(url: str) -> None:
    names = ("Übergröße", "ÜBERGRÖSSE", "коробка", "箱", "box")
    async with opened(url) as store:
        await store.write([interval(second, second, name=name) for second, name in enumerate(names)], [], NOW_S * S)
    for text, wanted in (
        ("über", {"Übergröße", "ÜBERGRÖSSE"}),
        ("GRÖßE", {"Übergröße", "ÜBERGRÖSSE"}),
        ("grösse", {"Übergröße", "ÜBERGRÖSSE"}),
        ("Короб", {"коробка"}),  # noqa: RUF001 - Cyrillic
        ("箱", {"箱"}),
        ("BOX", {"box"}),
        ("ü%", set()),
    ):
        assert {each.name for each in await Archive(url).sightings(HistoryQuery(text=text), 9)} == wanted, text
        entries = [Entry(each.sighting(), available=True) for each in await Archive(url).sightings(HistoryQuery(), 9)]
        listed = SightingTable(entries).wanted(Filters(text=text, in_view=False))
        assert {entry.sighting.name for entry in listed} == wanted, "as the table of the page finds them"


async def test_what_goes_on_is_of_now_though_it_began_long_ago(url: str) -> None:
    async with opened(url) as store:
        await store.write([interval(1, 2), interval(3, 3, is_open=True)], [], NOW_S * S)
    archive = Archive(url)
    assert await archive.sightings(HistoryQuery(since_ns=5 * S), 9) == [interval(3, NOW_S, is_open=True)]
    assert await archive.sightings(HistoryQuery(until_ns=2 * S), 9) == [interval(1, 2)]
    assert await archive.sightings(HistoryQuery(name="pallet"), 9) == []
    assert len(await archive.sightings(HistoryQuery(robot="r1", camera="front", name="box"), 9)) == 2


async def test_alerts_come_by_their_last_change_and_state_with_what_was_done(url: str) -> None:
    first = alert(id_="a1", changed_ns=NOW_S * S)
    second = alert(id_="a2", changed_ns=NOW_S * S, state=AlertState.ACKNOWLEDGED)
    act = Act("a2", AlertState.ACKNOWLEDGED, "ann", NOW_S * S)
    async with opened(url) as store:
        await store.write([], [first, second], NOW_S * S, [act])
    archive = Archive(url)
    assert await archive.alerts(HistoryQuery(), 1) == [second]
    assert await archive.alerts(HistoryQuery(), 9, (second.changed_ns, second.id)) == [first]
    assert await archive.alerts(HistoryQuery(), 9, states=[AlertState.RAISED]) == [first]
    assert await archive.acts(["a1", "a2"]) == [act]


async def test_without_a_history_there_is_nothing_to_read() -> None:
    with pytest.raises(HistoryError, match="--history none"):
        await Archive(NONE).sightings(HistoryQuery(), 1)


async def test_a_text_with_control_characters_is_found_where_it_is_and_is_no_error(url: str) -> None:
    async with opened(url) as store:
        await store.write([interval(1, 2), interval(3, 4, name="a\x1fb")], [alert()], 9 * S)
    archive = Archive(url)
    found = {
        text: [each.name for each in await archive.sightings(HistoryQuery(text=text), 9)] for text in ("\x1f", "A\x1fB")
    }
    assert found == {"\x1f": ["a\x1fb"], "A\x1fB": ["a\x1fb"]}
    for asked in (
        HistoryQuery(text="\0"),
        HistoryQuery(text="box\0"),
        HistoryQuery(robot="\0"),
        HistoryQuery(camera="\0"),
        HistoryQuery(name="\0"),
    ):
        assert await archive.sightings(asked, 9) == []
        assert (await archive.counts(replace(asked, since_ns=S, until_ns=9 * S))).most == {}
    assert await archive.alerts(HistoryQuery(robot="r1\0"), 9) == []
