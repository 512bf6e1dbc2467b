"""`fleetsight history`: the export of the history."""

import asyncio
import csv
from collections import Counter
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import polars as pl
import pytest
from msgspec.structs import replace
from pydantic import BaseModel, ValidationError

from services.monitor.history import engine, export
from services.monitor.history.clock_trust import Doubt
from services.monitor.history.export import exported as exported_row
from services.monitor.history.export import run
from services.monitor.history.settings import ExportSettings
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from services.monitor.web.api.models import AlertAnswer, IntervalAnswer
from tests.schemas.results import alert
from tests.services.monitor.history.support.filling import fill
from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.inventory.seeing import S

NAMES = [
    *("robot", "camera", "class", "since", "until", "open"),
    *("count", "score", "closest_m", "first_seen", "model", "worker"),
]


@pytest.fixture
async def url(tmp_path: Path) -> str:
    """A database with some history."""
    found = f"sqlite:///{tmp_path}/history.db"
    store = await Store.open(found)
    try:
        odd = interval(1, 2, name='"bo,x"\n箱')
        await store.write([odd, interval(3, 4), interval(5, 6, is_open=True)], [alert()], 9 * S)
    finally:
        await store.close()
    return found


async def exported(url: str, to: Path, **options: Any) -> list[dict[str, str]]:
    await run(ExportSettings(task="export", history=url, to=to, **options))
    with to.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


async def test_csv_has_every_column_and_what_goes_on_ends_at_the_heartbeat(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = await exported(url, tmp_path / "seen.csv")
    assert list(rows[0]) == NAMES
    assert [row["class"] for row in rows] == ['"bo,x"\n箱', "box", "box"]
    assert rows[2]["since"] == "1970-01-01T00:00:05.000000+00:00"
    assert (rows[2]["until"], rows[2]["open"]) == ("1970-01-01T00:00:09.000000+00:00", "True")
    assert capsys.readouterr().out == f"{tmp_path}/seen.csv: 3 sightings\n"
    assert (tmp_path / "seen.csv").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    ("options", "begins"),
    [
        ({"since": datetime(1970, 1, 1, 0, 0, 4, tzinfo=UTC)}, [3, 5]),
        ({"since": datetime(1970, 1, 1, 0, 0, 8, tzinfo=UTC)}, [5]),
        ({"until": datetime(1970, 1, 1, 0, 0, 3, tzinfo=UTC)}, [1, 3]),
        ({"class": "box"}, [3, 5]),
        ({"robot": "r2"}, []),
    ],
)
async def test_what_is_exported_can_be_chosen(
    url: str, tmp_path: Path, options: dict[str, Any], begins: list[int]
) -> None:
    rows = await exported(url, tmp_path / "seen.csv", **options)
    assert [int(datetime.fromisoformat(row["since"]).timestamp()) for row in rows] == begins


async def test_whatever_else_waits_has_its_turn_after_each_hundred_rows(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = await Store.open(url)
    try:
        await store.write([interval(since, since) for since in range(10, 1_000)], [], 1_000 * S)
    finally:
        await store.close()
    turns, rows_of_turn = 0, Counter[int]()

    async def take_turns() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    def counted(row: Mapping[str, Any]) -> dict[str, Any]:
        rows_of_turn[turns] += 1
        return exported_row(row)

    monkeypatch.setattr(export, "exported", counted)
    taking = asyncio.create_task(take_turns())
    rows = await exported(url, tmp_path / "seen.csv")
    taking.cancel()
    assert len(rows) == 993
    assert max(rows_of_turn.values()) <= 100


async def test_parquet_has_types(url: str, tmp_path: Path) -> None:
    to = tmp_path / "seen.parquet"
    await run(ExportSettings(task="export", history=url, to=to))
    frame = pl.read_parquet(to)
    assert frame.columns == NAMES
    assert frame["class"].to_list() == ['"bo,x"\n箱', "box", "box"]
    assert frame["since"].to_list()[0] == datetime(1970, 1, 1, 0, 0, 1, tzinfo=UTC)
    assert (frame["open"].to_list(), frame["count"].to_list()) == ([False, False, True], [2, 2, 2])
    assert frame["closest_m"].to_list() == [1.25] * 3


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        *((name, f"'{name}") for name in ("=1+1", "+1", "-1", "@sum(a1)")),
        *((f"{end}=1", f"'{end}'=1") for end in "\t\r\n"),
        *((f"box{end}=1", f"box{end}'=1") for end in (";", "; ", "\t", "\r\n")),
        *((name, name) for name in ("a-b", "box;2", "a=b")),
    ],
)
async def test_csv_has_no_formulas_and_parquet_what_was_said(tmp_path: Path, name: str, safe: str) -> None:
    url, parquet = f"sqlite:///{tmp_path}/history.db", tmp_path / "seen.parquet"
    store = await Store.open(url)
    try:
        await store.write([interval(1, 2, name=name)], [], 9 * S)
    finally:
        await store.close()
    (row,) = await exported(url, tmp_path / "seen.csv")
    assert (row["class"], row["score"], row["robot"]) == (safe, "0.5", "r1")
    await run(ExportSettings(task="export", history=url, to=parquet))
    assert pl.read_parquet(parquet)["class"].to_list() == [name]


@pytest.mark.parametrize(("what", "answer"), [("sightings", IntervalAnswer), ("alerts", AlertAnswer)])
async def test_columns_are_called_as_in_json(
    url: str, tmp_path: Path, what: Literal["sightings", "alerts"], answer: type[BaseModel]
) -> None:
    fields = {field.serialization_alias or name for name, field in answer.model_fields.items()}
    (row, *_) = await exported(url, tmp_path / "kept.csv", what=what)
    assert set(row) == fields - {"known_until", "acts", "link"}, "of an alert these are made when it is asked for"
    await run(ExportSettings(task="export", history=url, to=tmp_path / "kept.parquet", what=what))
    assert pl.read_parquet(tmp_path / "kept.parquet").columns == list(row)


async def test_figures_have_no_more_digits_than_are_known(tmp_path: Path) -> None:
    url, odd = f"sqlite:///{tmp_path}/history.db", replace(interval(1, 2), score=0.87654321, closest_m=2.1213203435)
    store = await Store.open(url)
    try:
        await store.write([odd], [], 9 * S)
    finally:
        await store.close()
    (row,) = await exported(url, tmp_path / "seen.csv")
    assert (row["score"], row["closest_m"]) == ("0.877", "2.121")


async def test_alerts_are_exported_too(url: str, tmp_path: Path) -> None:
    (row,) = await exported(url, tmp_path / "alerts.csv", what="alerts", camera="front")
    assert (row["id"], row["severity"], row["raised"]) == ("a1", "warning", "1970-01-01T00:00:00.000000+00:00")


async def test_a_database_that_is_not_there_is_not_made(tmp_path: Path) -> None:
    missing = f"sqlite:///{tmp_path}/other.db"
    with pytest.raises(HistoryError, match=r"other\.db: it does not exist"):
        await run(ExportSettings(task="export", history=missing, to=tmp_path / "seen.csv"))
    assert not (tmp_path / "other.db").exists()


async def test_a_file_that_cannot_be_written_is_called_as_it_was_asked_for(url: str, tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    for name, reason in (("nowhere/seen.csv", "No such file or directory"), ("folder.csv", "Is a directory")):
        with pytest.raises(HistoryError) as refused:
            await run(ExportSettings(task="export", history=url, to=tmp_path / name))
        assert str(refused.value) == f"{tmp_path / name}: {reason}"


@pytest.mark.parametrize("moment", ["yesterday", "6am", "2026-13-01", "2026-11-20T25:00"])
def test_a_time_that_is_none_is_refused_with_how_one_is_written(moment: str) -> None:
    with pytest.raises(ValidationError, match="write a time like 2026-11-20T06:00") as refused:
        ExportSettings.model_validate({"task": "export", "to": "seen.csv", "since": moment})
    assert refused.value.error_count() == 1


@pytest.mark.parametrize("wrong", [{"to": "seen.xlsx"}, {"history": "none"}, {"history": "mysql://x/y"}])
def test_wrong_settings(wrong: dict[str, str]) -> None:
    with pytest.raises(ValidationError):
        ExportSettings.model_validate({"task": "export", "to": "seen.csv", **wrong})


async def test_csv_begins_with_a_byte_order_mark_if_that_is_asked_for(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    async with opened(url) as store:
        await store.write([interval(1, 2, name="Übergröße")], [], 2 * S)
    texts = []
    for bom in (True, False):
        await run(ExportSettings(task="export", history=url, to=tmp_path / "seen.csv", bom=bom))
        texts.append((tmp_path / "seen.csv").read_bytes())
    assert texts[0] == b"\xef\xbb\xbf" + texts[1]
    assert "Übergröße".encode() in texts[1]


async def test_a_monitor_that_doubts_its_clock_is_told_that_it_is_right(
    url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ExportSettings(task="trust-clock", history=url)
    async with opened(url) as store:
        await run(settings)
        doubt = Doubt(S, 9 * S)
        await store.write_clock_doubt(doubt)
        assert await store.clock_doubt() == (doubt, False)
        await run(settings)
        assert await store.clock_doubt() == (doubt, True)
    assert capsys.readouterr().out == (
        "no monitor of this history doubts its clock\nthe clock is believed from now on\n"
    )


async def test_a_file_that_an_earlier_release_made_is_compacted_and_shrinks_from_then_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "history.db"
    url = f"sqlite:///{file}"
    monkeypatch.setattr(engine, "SHRINKS", "auto_vacuum=NONE")
    async with opened(url) as store:
        await fill(store, "intervals", 20_000, 0, 1_000)
        assert not await store.prune(2**62)
        await store.prune(2**62)
    monkeypatch.undo()
    before = file.stat().st_size
    await run(ExportSettings(task="compact", history=url))
    after = file.stat().st_size
    assert after < before / 5
    assert f"{before / 1e6:.1f} MB, {after / 1e6:.1f} MB after" in capsys.readouterr().out
    async with opened(url) as store:
        await fill(store, "intervals", 20_000, 0, 1_000)
        while not await store.prune(2**62):
            pass
    assert file.stat().st_size < before / 5


async def test_postgresql_is_not_compacted() -> None:
    with pytest.raises(HistoryError, match="PostgreSQL looks after its own"):
        await run(ExportSettings(task="compact", history="postgresql://somebody@127.0.0.1:1/db"))


def test_an_export_needs_a_file_and_nothing_else_takes_one() -> None:
    with pytest.raises(ValidationError, match="export needs --to"):
        ExportSettings(task="export")
    with pytest.raises(ValidationError, match="compact takes only --history, not --to"):
        ExportSettings(task="compact", to=Path("seen.csv"))
