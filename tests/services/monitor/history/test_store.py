import asyncio
import os
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from pathlib import Path

import pytest
from msgspec.structs import replace
from sqlalchemy import inspect
from sqlalchemy.schema import DropIndex, DropTable

from schemas.alerts import AlertState
from schemas.keys import CameraKey
from services.monitor.history import row_maintenance
from services.monitor.history import store as module
from services.monitor.history.archive import Archive, HistoryQuery, WorldQuery
from services.monitor.history.intervals import Disagreement, Interval
from services.monitor.history.presence import Presence
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from services.monitor.history.tables import (
    alert_objects,
    clock_doubt,
    disagreements,
    object_events,
    open_alerts,
    poses,
    presence,
    schema_version,
    stock,
    webhook_backlog,
)
from services.monitor.map.pose import Pose
from tests.schemas.results import alert
from tests.services.monitor.history.support.postgresql import PostgreSQL
from tests.services.monitor.history.support.stored_intervals import disagreement, there
from tests.services.monitor.inventory.seeing import FRONT, S


def interval(
    since_s: int, until_s: int, *, key: CameraKey = FRONT, is_open: bool = False, name: str = "box"
) -> Interval:
    since_ns, until_ns = since_s * S, until_s * S
    return Interval(key, name, 2, 0.5, 1.25, since_ns, "m", "w", since_ns=since_ns, until_ns=until_ns, open=is_open)


@asynccontextmanager
async def opened(url: str) -> AsyncIterator[Store]:
    store = await Store.open(url)
    try:
        yield store
    finally:
        await store.close()


async def every(store: Store) -> list[Interval]:
    return await store.select(Interval)


async def test_what_was_written_is_there_for_the_next_process(url: str) -> None:
    async with opened(url) as store:
        assert await store.heartbeat_ns() == 0
        await store.write([interval(1, 2), interval(3, 4, is_open=True)], [alert()], 9 * S)
    async with opened(url) as store:
        assert await every(store) == [interval(1, 2), interval(3, 9, is_open=True)]
        kept = await store.load(0)
        assert kept.intervals == [interval(3, 9, is_open=True)]
        assert kept.alerts == [alert()]


async def test_who_was_there_and_what_models_disagreed_about_is_kept_beside_it(url: str) -> None:
    written = [
        there(1, 2),
        there(3, 4, is_open=True),
        there(3, 5, camera="front"),
        there(1, 1, "", is_open=True),
        disagreement(1, 2, name="bo\0x"),
        disagreement(3, 3, (0, 7), is_open=True),
        interval(4, 4, is_open=True),
    ]
    async with opened(url) as store:
        assert await store.last_present() == {}
        await store.write(written, [], 9 * S)
    async with opened(url) as store:
        led, first, front, second = (there(1, 9, "", is_open=True), written[0], written[2], there(3, 9, is_open=True))
        assert sorted(await store.select(Presence), key=repr) == sorted([led, first, front, second], key=repr)
        odd, disagreed = await store.select(Disagreement)
        assert (odd, disagreed) == (disagreement(1, 2, name="bo␀x"), disagreement(3, 9, (0, 7), is_open=True))
        kept = await store.load(0)
        going_on = [interval(4, 9, is_open=True), led, second, disagreed]
        assert (kept.intervals, list(kept.going_on)) == (going_on[:1], going_on)
        assert await store.last_present() == {("r1", ""): 9 * S, ("r1", "front"): 5 * S}
        found = await store.select(Presence, presence.c.robot != "", since_ns=5 * S)
        assert found in ([second, front], [front, second])


async def test_a_database_of_an_earlier_release_goes_on_with_what_it_has(url: str) -> None:
    async with opened(url) as store:
        await store.write([interval(1, 2)], [alert()], 2 * S)
        async with store._connection.begin():
            for table in (schema_version, presence, disagreements, poses):
                await store._connection.execute(DropTable(table))
    async with opened(url) as store:
        assert (await every(store), await store.select(Presence), await store.last_present()) == (
            [interval(1, 2)],
            [],
            {},
        )
        await store.write([there(3, 4), disagreement(3, 4)], [], 5 * S)
        assert (await store.select(Presence), await store.select(Disagreement)) == ([there(3, 4)], [disagreement(3, 4)])


async def test_a_database_without_what_came_later_is_read_and_then_completed(url: str) -> None:
    async with opened(url) as store:
        await store.write([interval(1, 2)], [alert()], 2 * S)
        async with store._connection.begin():
            for table in (clock_doubt, webhook_backlog, stock, object_events, alert_objects):
                await store._connection.execute(DropTable(table))
            await store._connection.execute(DropIndex(open_alerts))
    assert await Archive(url).alerts(HistoryQuery(), 9, states=[AlertState.RAISED]) == [alert()]
    assert await Archive(url).object_events(WorldQuery(), 9) == []
    async with opened(url) as store:
        assert (await store.load(0)).alerts == [alert()]
        assert await store.clock_doubt() == (None, False)
        assert await store._connection.run_sync(lambda of: inspect(of).has_index("alerts", "alerts_open"))


async def test_of_each_class_that_ended_the_last_interval_is_known_and_of_each_place_when_somebody_was_there(
    url: str,
) -> None:
    rear, other = CameraKey("r1", "rear"), CameraKey("r10", "front")
    last = [interval(5, 6), interval(3, 4, name="pallet"), interval(7, 9, key=rear), interval(1, 2, key=other)]
    before = [interval(1, 2), interval(3, 4), interval(1, 2, name="pallet"), interval(2, 3, key=rear)]
    places = [(robot, camera) for robot in ("r1", "r10") for camera in ("", "c")]
    present = [there(since, since + 1, *place) for since in (1, 3) for place in places]
    async with opened(url) as store:
        await store.write([*before, *last, *present, there(1, 9, ""), there(8, 8, "r9", "c", is_open=True)], [], 20 * S)
        assert sorted((await store.load(0)).intervals, key=last.index) == last
        assert (await store.load(5 * S)).intervals == [last[2], last[0]]
        assert await store.last_present() == {**dict.fromkeys(places, 4 * S), ("r9", "c"): 20 * S}


async def test_an_alert_s_site_and_object_are_kept_with_it_and_deleted_with_it(url: str) -> None:
    of_site = replace(alert(), id="s", site="hall", state=AlertState.RAISED)
    of_object = replace(of_site, id="o", object="a\0b", changed_ns=5 * S)
    kept = replace(of_object, object="a\N{SYMBOL FOR NULL}b")
    async with opened(url) as store:
        await store.write([], [alert(), of_site, of_object], 9 * S)
        await store.owe([("ops", of_object)], [])
        state = await store.load(0)
        assert sorted(state.alerts, key=lambda each: each.id) == [alert(), kept, of_site]
        assert state.owed == [("ops", kept)]
        found = await Archive(url).alerts(HistoryQuery(), 9)
        assert {(each.id, each.site, each.object) for each in found} == {
            ("a1", "", ""), ("s", "hall", ""), ("o", "hall", kept.object)
        }  # fmt: skip
        await store.write([], [replace(of_object, state=AlertState.RESOLVED)], 9 * S)
        assert await store.prune(99 * S)
        left = (await store._connection.execute(alert_objects.select())).all()
        assert [row.alert_id for row in left] == ["s"]


async def test_where_robots_were_last_is_kept(url: str) -> None:
    async with opened(url) as store:
        await store.write_poses({"r1": Pose(1.5, -2.0, 0.25, 5 * S), "r2": Pose(0, 0, 0, 7 * S)})
        await store.write_poses({"r1": Pose(2.5, -2.0, 0.25, 9 * S)})
    async with opened(url) as store:
        assert await store.poses(8 * S) == {"r1": Pose(2.5, -2.0, 0.25, 9 * S)}
        assert set(await store.poses(0)) == {"r1", "r2"}
        await store.prune(8 * S)
        assert set(await store.poses(0)) == {"r1"}


async def test_the_newest_are_read_whenever_they_began(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_LOADED", 3)
    old, going_on = there(1, 8), there(1, 1, "r2", is_open=True)
    async with opened(url) as store:
        flaps = [there(number, number, "r3") for number in range(2, 7)]
        await store.write([old, going_on, *flaps], [], 9 * S)
        found = await store.select(Presence)
        assert {(of.since_ns // S, of.robot) for of in found} == {(1, "r1"), (1, "r2"), (6, "r3")}


async def test_writing_again_changes_what_is_there(url: str) -> None:
    async with opened(url) as store:
        await store.write([interval(1, 2, is_open=True)], [alert()], 2 * S)
        resolved = alert(state=AlertState.RESOLVED)
        await store.write([interval(1, 5)], [resolved], 6 * S)
        assert await every(store) == [interval(1, 5)]
        kept = await store.load(6 * S)
        assert (kept.intervals, kept.alerts) == ([], [])
        assert (await store.load(5 * S)).intervals == [interval(1, 5)]


async def test_texts_that_a_database_would_refuse_are_kept_legible(url: str) -> None:
    async with opened(url) as store:
        odd = "bo\0x'; DROP TABLE intervals --箱" + "x" * 200
        await store.write([interval(1, 2, name=odd)], [], 2 * S)
        (found,) = await every(store)
        assert found.name == odd.replace("\0", "␀")


async def test_one_of_two_leads_until_it_goes(url: str) -> None:
    async with opened(url) as second:
        async with opened(url) as first:
            assert await first.lead()
            assert await first.lead()
            assert not await second.lead()
            assert await second.leader() == f"{socket.gethostname()}, process {os.getpid()}"
        assert await second.lead()


async def test_one_that_leads_and_is_not_heard_of_any_more_is_taken_over_from(
    postgresql: PostgreSQL, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "UNHEARD_S", 0.2)
    url = postgresql.create("unheard")
    async with opened(url) as first, opened(url) as second:
        assert await first.lead()
        monkeypatch.undo()
        async with asyncio.timeout(60):
            while not await second.lead():  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.02)
        with pytest.raises(HistoryError):
            await first.write([interval(1, 2)], [], 2 * S)
        await second.write([interval(3, 4)], [], 4 * S)
        assert await every(second) == [interval(3, 4)]


async def test_what_webhooks_did_not_take_is_kept_until_they_did(url: str) -> None:
    some = [alert(id_=name, text=name) for name in ("a1", "a2")]
    async with opened(url) as store:
        await store.write([], some, 1)
        await store.owe([*(("ops", each) for each in some), ("on call", some[0]), ("ops", alert(id_="gone"))], [])
        newer = alert(id_="a2", text="newer", changed_ns=9)
        await store.write([], [newer], 2)
    async with opened(url) as store:
        assert set((await store.load(0)).owed) == {("ops", some[0]), ("ops", newer), ("on call", some[0])}
        await store.owe([("ops", newer)], [("ops", "a1"), ("on call", "a1")])
        assert (await store.load(0)).owed == [("ops", newer)]


async def test_old_history_is_forgotten_but_not_what_goes_on(url: str) -> None:
    async with opened(url) as store:
        old = [interval(1, 2), interval(3, 4, is_open=True), interval(5, 10)]
        await store.write(old, [alert(), alert(id_="b", state=AlertState.RESOLVED)], 10 * S)
        await store.prune(10 * S)
        assert await every(store) == [interval(3, 10, is_open=True), interval(5, 10)]
        await store.prune(2**62)
        assert await every(store) == [interval(3, 10, is_open=True)]
        assert [each.id for each in (await store.load(0)).alerts] == [alert().id]


async def test_old_history_of_each_kind_is_forgotten(url: str) -> None:
    async with opened(url) as store:
        stays = [there(1, 9, is_open=True), disagreement(1, 9, is_open=True)]
        await store.write([*stays, there(5, 6, "r2"), disagreement(5, 6, name="pallet")], [], 9 * S)
        assert await store.prune(6 * S)
        assert (len(await store.select(Presence)), len(await store.select(Disagreement))) == (2, 2)
        assert await store.prune(2**62)
        assert [*await store.select(Presence), *await store.select(Disagreement)] == stays


async def test_much_old_history_is_forgotten_bit_by_bit(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(row_maintenance, "SLICE", 3)
    async with opened(url) as store:
        assert await store.prune(9 * S)
        some = [interval(since, max(since, 4)) for since in range(1, 9)]
        await store.write([*some, interval(0, 0, is_open=True, name="pallet"), interval(9, 9)])
        left = [[1, 2, 3, 4, 5, 6, 7, 8], [5, 6, 7, 8], [8], []]
        for before, after in pairwise(left):
            assert [each.since_ns // S for each in await every(store)] == [0, *before, 9]
            assert await store.prune(9 * S) is (len(before) < 3)
            assert [each.since_ns // S for each in await every(store)] == [0, *after, 9]


async def test_what_was_so_last_is_found_without_a_look_at_all_history(tmp_path: Path) -> None:
    async with opened(f"sqlite:///{tmp_path}/history.db") as store:
        flaps = [each for second in range(5_000) for each in (interval(second, second), there(second, second))]
        await store.write(flaps, [], 5_000 * S)
        database = (await store._connection.get_raw_connection()).driver_connection
        assert database is not None
        steps: list[int] = []
        await database.set_progress_handler(lambda: steps.append(1), 1)
        for since_s in (0, 4_990):
            assert len((await store.load(since_s * S)).intervals) == 1
            assert await store.last_present() == {("r1", ""): 4_999 * S}
        assert len(await store.select(Interval, since_ns=4_990 * S)) == 10
        assert len(steps) < 5_000
