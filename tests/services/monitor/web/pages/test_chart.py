"""Counts over time."""

import time
from pathlib import Path

from schemas.keys import CameraKey
from services.monitor.history.archive import Archive
from services.monitor.history.counting import Counts, Slots
from services.monitor.history.intervals import Interval
from services.monitor.history.store import Store
from services.monitor.web.pages.chart import MAX_KEPT, MAX_LINES, RANGES, Charts, Subject, counts_over_time, options
from tests.services.monitor.history.test_store import interval, opened

S = 1_000_000_000


async def test_a_chart_says_why_there_is_none() -> None:
    drawn = await Charts(Archive("none")).of(Subject())
    assert drawn.lines == {}
    assert "--history none" in drawn.problem


async def test_a_chart_is_read_once_for_all_who_look(tmp_path: Path) -> None:
    charts = Charts(Archive(f"sqlite:///{tmp_path / 'none.db'}"))
    first = await charts.of(Subject())
    assert await charts.of(Subject()) is first
    for number in range(MAX_KEPT):
        await charts.of(Subject(robot=f"r{number}"))
    assert await charts.of(Subject()) is not first


async def test_a_chart_shows_what_the_history_has_of_its_subject(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.db'}"
    store = await Store.open(url)
    for robot in ("r1", "r2"):
        goes_on = Interval(
            key=CameraKey(robot, "front"),
            name="box",
            since_ns=S,
            until_ns=S,
            open=True,
            count=2,
            score=0.5,
            closest_m=None,
            first_ns=S,
            model="m",
            worker="w",
        )
        await store.write([goes_on], [], time.time_ns())
    await store.close()
    charts = Charts(Archive(url))
    assert (await charts.of(Subject())).lines["box"][-1][1] == 4
    assert (await charts.of(Subject(text="R1"))).lines["box"][-1][1] == 2
    assert (await charts.of(Subject(text="r%"))).lines == {}
    drawn = await charts.of(Subject(robot="r2", name="box"))
    assert drawn.lines["box"][-1][1] == 2
    (series,) = options(drawn)["series"]
    assert (series["name"], series["data"][-1]) == ("box", [drawn.until_ns // 1_000_000, 2])


async def test_a_chart_of_a_week_of_many_changes_begins_where_the_week_does(tmp_path: Path) -> None:
    url, now_s = f"sqlite:///{tmp_path / 'history.db'}", int(time.time())
    short = [interval(now_s - ago, now_s - ago + 1, name="person") for ago in range(1, 10_000)]
    first = interval(now_s - 500_000, now_s - 490_000, name="pallet")
    async with opened(url) as store:
        await store.write([first, *short], [], now_s * S)
    drawn = await Charts(Archive(url)).of(Subject(seconds=RANGES["7 d"]))
    assert drawn.until_ns - drawn.since_ns == RANGES["7 d"] * S
    assert drawn.lines.keys() == {"pallet", "person"}
    counts = [count for _, count in drawn.lines["pallet"]]
    assert [counts[0], 2 in counts, None in counts, 0 in counts] == [None, True, True, True]


def test_a_subject_is_said_in_words() -> None:
    assert str(Subject()) == "all classes, whole fleet"
    assert str(Subject(robot="r1", camera="front", name="box")) == "box, r1/front"
    assert str(Subject(text="dock")) == "all classes, whole fleet, with dock in a name"


SLOTS = Slots(100 * S, 150 * S, 10 * S)


def test_a_count_lasts_until_the_next_and_the_last_until_the_end() -> None:
    lines = counts_over_time(Counts(SLOTS, {"box": {0: 1, 1: 1, 2: 3}}, {0, 1, 2, 3, 4}))
    assert lines == {"box": [(100_000, 1), (120_000, 3), (130_000, 0), (150_000, 0)]}


def test_where_nobody_knows_there_is_a_gap() -> None:
    lines = counts_over_time(Counts(SLOTS, {"box": {1: 2, 4: 2}}, {1, 2, 4}))
    assert lines == {"box": [(100_000, None), (110_000, 2), (120_000, 0), (130_000, None), (140_000, 2), (150_000, 2)]}


def test_the_classes_with_the_most_are_shown() -> None:
    most = {f"c{count}": {0: count} for count in range(1, MAX_LINES + 3)}
    lines = counts_over_time(Counts(SLOTS, most, {0}))
    assert list(lines) == [f"c{count}" for count in range(MAX_LINES + 2, 2, -1)]
