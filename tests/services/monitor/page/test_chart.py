import time
from pathlib import Path

from schemas.keys import CameraKey
from services.monitor.history.archive import Archive
from services.monitor.history.intervals import Interval
from services.monitor.history.store import Store
from services.monitor.page.chart import MAX_INTERVALS, MAX_KEPT, Charts, Subject, options
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
        await store.write([goes_on], [], S)
    await store.close()
    charts = Charts(Archive(url))
    assert (await charts.of(Subject())).lines["box"][-1][1] == 4
    assert (await charts.of(Subject(text="R1"))).lines["box"][-1][1] == 2
    assert (await charts.of(Subject(text="r%"))).lines == {}
    drawn = await charts.of(Subject(robot="r2", name="box"))
    assert drawn.lines["box"][-1][1] == 2
    (series,) = options(drawn)["series"]
    assert (series["name"], series["data"][-1]) == ("box", [drawn.until_ns // 1_000_000, 2])


async def test_a_chart_of_more_than_it_reads_has_what_was_in_view_before(tmp_path: Path) -> None:
    url, now_s = f"sqlite:///{tmp_path / 'history.db'}", int(time.time())
    cameras = [CameraKey(f"r{number}", "front") for number in range(5)]
    long = [interval(now_s - 3_000, now_s, key=key, name="pallet", is_open=True) for key in cameras]
    gone = interval(now_s - 3_000, now_s - 100, key=CameraKey("r9", "front"), name="pallet")
    before = interval(now_s - 3_000, now_s - 2_000, name="forklift")
    short = [
        interval(now_s - ago, now_s - ago + 1, key=key, name="person")
        for ago in range(1, 1 + 2 * MAX_INTERVALS // len(cameras))
        for key in cameras
    ]
    async with opened(url) as store:
        await store.write([*long, gone, before, *short], [], now_s * S)
    charts = Charts(Archive(url))
    drawn = await charts.of(Subject())
    assert (drawn.whole, drawn.since_ns) == (False, (now_s - MAX_INTERVALS // len(cameras)) * S)
    assert drawn.lines.keys() == {"pallet", "person"}
    assert [count for _, count in drawn.lines["pallet"]] == [0, 12, 10, 10]
    minute = await charts.of(Subject(seconds=60))
    assert max(count for _, count in minute.lines["pallet"]) == 10
    pallets = await charts.of(Subject(name="pallet"))
    assert (pallets.whole, [count for _, count in pallets.lines["pallet"]]) == (True, [0, 12, 10, 10])


async def test_nothing_is_counted_twice_where_more_is_in_view_than_is_read(tmp_path: Path) -> None:
    url, now_s = f"sqlite:///{tmp_path / 'history.db'}", int(time.time())
    many = [
        interval(now_s - 7_200, now_s, key=CameraKey(f"r{number}", "front"), name="pallet", is_open=True)
        for number in range(MAX_INTERVALS + 1_000)
    ]
    async with opened(url) as store:
        await store.write(many, [], now_s * S)
    drawn = await Charts(Archive(url)).of(Subject())
    assert max(count for _, count in drawn.lines["pallet"]) == 2 * len(many)


def test_a_subject_is_said_in_words() -> None:
    assert str(Subject()) == "all classes, whole fleet"
    assert str(Subject(robot="r1", camera="front", name="box")) == "box, r1/front"
    assert str(Subject(text="dock")) == "all classes, whole fleet, with dock in a name"
