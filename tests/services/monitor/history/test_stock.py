"""How many objects a zone held over time, counted, paged and exported, on either database."""

import csv
from pathlib import Path

import polars as pl
import pytest
from msgspec.structs import replace
from pydantic import ValidationError
from sqlalchemy.schema import DropTable

from services.monitor.history import counting as module
from services.monitor.history.archive import Archive, WorldQuery
from services.monitor.history.counting import SLOTS
from services.monitor.history.export import run
from services.monitor.history.settings import ExportSettings
from services.monitor.history.tables import alert_objects, stock
from services.monitor.history.world_history import ALL_CLASSES, ObjectEvent, StockLevel
from services.monitor.web.pages.chart import Charts, StockSubject, counts_over_time
from services.monitor.world.site_objects import SITE
from tests.schemas.results import alert
from tests.services.monitor.history.test_store import opened
from tests.services.monitor.inventory.seeing import S
from tests.services.monitor.web.asking import web_in

NOW_S = 1_700_000_000
SLOT_S = 3_600 // SLOTS


def level(
    count: int, ago_s: int, until_ago_s: int = 0, *, name: str = "box", zone: str = "dock", site: str = "hall"
) -> StockLevel:
    return StockLevel(
        since_ns=(NOW_S - ago_s) * S,
        until_ns=(NOW_S - until_ago_s) * S,
        open=not until_ago_s,
        site=site,
        zone=zone,
        name=name,
        count=count,
    )


LEVELS = (
    level(2, 3_000, 2_000),
    level(5, 2_000, 1_000),
    level(1, 1_500, name="pallet"),
    level(7, 3_000, name="box", zone=SITE),
    level(9, 3_000, name="box", site="yard"),
    *(level(0, 3_000, 600, name=ALL_CLASSES, zone=zone) for zone in ("dock", SITE)),
    level(0, 300, name=ALL_CLASSES),
)


@pytest.fixture
async def kept(url: str) -> str:
    async with opened(url) as store:
        event = ObjectEvent(
            since_ns=NOW_S * S,
            until_ns=NOW_S * S,
            open=False,
            site="hall",
            object="a",
            kind="gone",
            name="box",
            x=1,
            y=2,
        )
        await store.write([*LEVELS, event], [], NOW_S * S)
    return url


def asked(zone: str = "dock", **more: str) -> WorldQuery:
    return WorldQuery((NOW_S - 3_600) * S, NOW_S * S, site="hall", zone=zone, **more)


@pytest.mark.parametrize("how", ["counted", "looked at"])
async def test_what_a_zone_held_is_counted_by_class_with_gaps_where_it_is_not_known(
    kept: str, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    if how == "looked at":
        monkeypatch.setattr(module, "EXACT", 0)
    counts = await Archive(kept).stock_counts(asked())
    slot = counts.slots.width_ns // S

    def at(ago_s: int) -> int:
        return (3_600 - ago_s) // slot

    assert [counts.most["box"].get(at(ago_s), 0) for ago_s in (3_200, 2_500, 1_500, 500)] == [0, 2, 5, 0]
    assert [counts.most["pallet"].get(at(ago_s), 0) for ago_s in (2_500, 1_200, 100)] == [0, 1, 1]
    assert set(counts.most) == {"box", "pallet"}
    assert [at(ago_s) in counts.known for ago_s in (3_300, 2_500, 100)] == [False, True, True]
    points = counts_over_time(counts)["box"]
    assert points[0][1] is None
    whole = await Archive(kept).stock_counts(asked(SITE))
    assert (set(whole.most), whole.most["box"][at(100)]) == ({"box"}, 7)
    one = await Archive(kept).stock_counts(asked(name="pallet"))
    assert set(one.most) == {"pallet"}
    for nowhere in (asked("\0"), asked("no such zone")):
        assert (await Archive(kept).stock_counts(nowhere)).most == {}


async def test_levels_come_in_pages_newest_first(kept: str) -> None:
    archive = Archive(kept)
    first = await archive.stock(asked(), 2)
    assert [(each.name, each.since_ns // S - NOW_S, each.open) for each in first] == [
        (ALL_CLASSES, -300, True),
        ("pallet", -1_500, True),
    ]
    last = first[-1]
    rest = await archive.stock(asked(), 9, (last.since_ns, last.site, last.zone, last.name))
    assert [(each.name, each.count) for each in rest] == [("box", 5), ("box", 2), (ALL_CLASSES, 0)]
    assert len(await archive.stock(WorldQuery(zone=None), 99)) == len(LEVELS)
    assert [each.count for each in await archive.stock(WorldQuery(name="box", zone=SITE), 9)] == [7]
    assert await archive.stock(WorldQuery(site="\0"), 9) == []


async def test_stock_and_events_are_exported(kept: str, tmp_path: Path) -> None:
    file = tmp_path / "stock.csv"
    given = {"task": "export", "history": kept}
    await run(ExportSettings.model_validate({**given, "to": file, "what": "stock", "zone": "dock", "class": "box"}))
    rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
    assert {(row["site"], row["zone"], row["class"], row["count"], row["open"]) for row in rows} == {
        ("yard", "dock", "box", "9", "True"),
        ("hall", "dock", "box", "2", "False"),
        ("hall", "dock", "box", "5", "False"),
    }
    assert rows[-1]["count"] == "5"
    await run(ExportSettings.model_validate({**given, "to": tmp_path / "stock.parquet", "what": "stock"}))
    assert pl.read_parquet(tmp_path / "stock.parquet").schema["since"] == pl.Datetime("us", "UTC")
    await run(ExportSettings.model_validate({**given, "to": file, "what": "events", "site": "hall"}))
    (row,) = csv.DictReader(file.read_text(encoding="utf-8").splitlines())
    assert (row["object"], row["kind"], row["x"], row["from_x"]) == ("a", "gone", "1.0", "")


async def test_alerts_are_exported_with_the_objects_that_they_are_about(url: str, tmp_path: Path) -> None:
    file = tmp_path / "alerts.csv"
    asked = ExportSettings(task="export", history=url, to=file, what="alerts")
    async with opened(url) as store:
        about = replace(alert(), id="o", site="hall", object="a", raised_ns=alert().raised_ns + 1)
        await store.write([], [alert(), about], NOW_S * S)
        await run(asked)
        rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
        assert [(row["id"], row["site"], row["object"]) for row in rows] == [("a1", "", ""), ("o", "hall", "a")]
        async with store._connection.begin():
            for later in (alert_objects, stock):
                await store._connection.execute(DropTable(later))
        await run(asked)
        assert len(file.read_text(encoding="utf-8").splitlines()) == 3
        await run(asked.model_copy(update={"what": "stock"}))
        assert len(file.read_text(encoding="utf-8").splitlines()) == 1


async def test_old_stock_is_deleted_and_what_goes_on_is_not(kept: str) -> None:
    async with opened(kept) as store:
        assert await store.prune((NOW_S - 500) * S)
        left = await store.select(StockLevel)
        assert all(each.open for each in left)
        assert len(left) == 4
        assert len(await store.select(ObjectEvent)) == 1


async def test_the_chart_of_a_zone_is_of_its_stock(tmp_path: Path) -> None:
    drawn = await Charts(Archive(f"sqlite:///{tmp_path / 'none.db'}")).of(StockSubject("hall", "dock"))
    assert "does not exist" in drawn.problem


async def test_stock_is_answered_over_http(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    async with opened(url) as store:
        await store.write(LEVELS, [], NOW_S * S)
    async with web_in(tmp_path, history=url) as web, await web.program() as program:
        every = (await program.get("/api/v1/history/stock?since=0&site=hall&zone=&class=box")).json()["items"]
        assert [(each["zone"], each["class"], each["count"], each["open"]) for each in every] == [("", "box", 7, True)]
        page = (await program.get("/api/v1/history/stock?since=0&limit=1")).json()
        assert page["items"][0]["since"] == "2023-11-14T22:08:20Z"
        answer = await program.get("/api/v1/history/export?since=0&what=stock&site=yard")
        assert len(answer.text.splitlines()) == 2
        wrong = await program.get("/api/v1/history/export?what=stock&robot=r1")
        assert wrong.status_code == 422
        assert "stock has no robot" in wrong.json()["error"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"what": "stock", "robot": "r1"}, "stock has no --robot; narrow it down by --site, --zone or --class"),
        ({"what": "events", "zone": "dock"}, "events has no --zone; narrow it down by --site or --class"),
        ({"site": "hall"}, "sightings has no --site"),
        ({"what": "events", "site": "a/b"}, "site"),
    ],
)
def test_what_does_not_narrow_it_down_is_refused(given: dict[str, str], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        ExportSettings.model_validate({"task": "export", "to": "x.csv", **given})
