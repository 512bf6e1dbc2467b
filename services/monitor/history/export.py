"""`fleetsight history`: writes the history to CSV or Parquet files."""

import asyncio
import csv
import sys
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, TextIO

from sqlalchemy import Column, ColumnElement, FromClause, Select, Table, case, func, inspect, literal, select
from sqlalchemy.ext.asyncio import AsyncEngine

from services.monitor.formats import as_text, epoch_ns, moment, rounded
from services.monitor.history.backup import back_up, restore
from services.monitor.history.engine import engine_of, translating
from services.monitor.history.opening import connect
from services.monitor.history.row_maintenance import compact
from services.monitor.history.settings import ExportSettings
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from services.monitor.history.tables import alert_objects, alerts, heartbeat, intervals, object_events, stock

PRIVATE: Final = 0o600
"""Rights of an exported file: its owner reads it, and nobody else."""

TIME: Final = "_ns"
"""Suffix of nanosecond time columns; exported ones drop it and are UTC to the microsecond."""

Columns = Sequence[Column[Any]]

AS_IN_JSON: Final = {"name": "class", "first_ns": "first_seen"}
"""Columns that have another name in the HTTP API: files use the API's."""


async def write_csv(
    batches: AsyncIterator[Sequence[Mapping[str, Any]]], columns: Columns, file: TextIO, *, for_people: bool
) -> int:
    """Write rows below a heading; return their number. for_people: formulas become text, for spreadsheets."""
    writer = csv.DictWriter(file, [exported_name(column.name) for column in columns])
    writer.writeheader()
    count = 0
    async for batch in batches:
        rows = (exported(row) for row in batch)
        writer.writerows({name: as_text(value) for name, value in row.items()} if for_people else row for row in rows)
        count += len(batch)
    return count


def exported_name(column: str) -> str:
    """Return the exported name of a table's column."""
    return AS_IN_JSON.get(column, column.removesuffix(TIME))


def exported(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row in exported form."""
    return {
        exported_name(name): moment(value).isoformat(timespec="microseconds") if name.endswith(TIME) else rounded(value)
        for name, value in row.items()
    }


def write_parquet(source: Path, target: Path, columns: Columns) -> None:
    """Convert a CSV file of rows with such columns to Parquet."""
    import polars as pl  # noqa: PLC0415 - an extra, and only who wants Parquet needs it

    kinds = {str: pl.String, int: pl.Int64, float: pl.Float64, bool: pl.String}
    schema = {
        exported_name(column.name): pl.String if column.name.endswith(TIME) else kinds[column.type.python_type]
        for column in columns
    }
    times = [
        pl.col(exported_name(column.name)).str.to_datetime(time_unit="us", time_zone="UTC")
        for column in columns
        if column.name.endswith(TIME)
    ]
    flags = [pl.col(exported_name(column.name)) == "True" for column in columns if column.type.python_type is bool]
    rows = pl.scan_csv(source, schema=schema).with_columns(pl.col(pl.String).fill_null(""))
    rows.with_columns(*times, *flags).sink_parquet(target)


EXPORTED: Final[Mapping[str, Table]] = {
    "sightings": intervals,
    "alerts": alerts,
    "stock": stock,
    "events": object_events,
}

OF_ALERTS: Final = (alert_objects.c.site, alert_objects.c.object)
"""Columns of alerts that are in a table of their own."""

ROWS: Final = 100
"""Rows held in memory and written at a time; an exporting monitor processes class lists in between."""

LONG_S: Final = 3_600.0


async def run(settings: ExportSettings) -> None:
    """Run the task and print its result; see `export`.

    Raises:
        HistoryError: the database cannot be had, or the file not be written.
    """
    if settings.task == "export":
        said = f"{settings.to}: {await export(settings)} {settings.what}"
    elif settings.task == "backup":
        said = await back_up(settings.history, settings.to or Path())
    elif settings.task == "restore":
        said = await restore(settings.history, settings.source or Path())
    elif settings.task == "trust-clock":
        said = await _trust_clock(settings.history)
    else:
        said = await compact(settings.history)
    sys.stdout.write(f"{said}\n")


async def export(settings: ExportSettings) -> int:
    """Write the file atomically; return the number of rows.

    Raises:
        HistoryError: the database cannot be read, or the file not be written.
    """
    assert settings.to is not None, "settings without a file are refused"  # noqa: S101 - for the type
    engine = engine_of(settings.history)
    table = EXPORTED[settings.what]
    try:
        async with translating(LONG_S):
            return await _write(engine, settings, settings.to, table)
    finally:
        await engine.dispose()


async def _trust_clock(history: str) -> str:
    store = await Store.open(history, create=False, complete=True)
    try:
        doubted = await store.trust_clock()
    finally:
        await store.close()
    return "the clock is believed from now on" if doubted else "no monitor of this history doubts its clock"


async def _write(engine: AsyncEngine, settings: ExportSettings, to: Path, table: Table) -> int:
    try:
        with TemporaryDirectory(dir=to.parent, prefix=".fleetsight-") as folder:
            made, count = await _write_in(Path(folder), engine, settings, table, to_parquet=to.suffix == ".parquet")
            made.chmod(PRIVATE)
            made.replace(to)
            return count
    except OSError as error:
        if error.filename is None:  # may come from a database that cannot be reached
            raise
        raise HistoryError(f"{to}: {error.strerror}") from error


async def _write_in(
    folder: Path, engine: AsyncEngine, settings: ExportSettings, table: Table, *, to_parquet: bool
) -> tuple[Path, int]:
    made, columns = folder / "rows.csv", [*table.columns, *(OF_ALERTS if table is alerts else ())]
    encoding = "utf-8-sig" if settings.bom and not to_parquet else "utf-8"
    with made.open("w", encoding=encoding, newline="") as rows:
        batches = _batches(engine, settings, table)
        count = await write_csv(batches, columns, rows, for_people=not to_parquet)
    if to_parquet:
        await asyncio.to_thread(write_parquet, made, folder / "rows.parquet", columns)
        made = folder / "rows.parquet"
    return made, count


def query_of(settings: ExportSettings, table: Table, *, has_objects: bool = True) -> Select[Any]:
    """Return the export's query, oldest first; open intervals last until the heartbeat.

    has_objects: the database says of alerts which site and object they are about.
    """
    columns: list[Any] = list(table.columns)
    rows: FromClause = table
    begins: ColumnElement[int]
    ends: ColumnElement[int]
    if table is alerts:
        begins, ends = alerts.c.raised_ns, alerts.c.changed_ns
        if has_objects:
            rows = alerts.outerjoin(alert_objects, alert_objects.c.alert_id == alerts.c.id)
        columns += [(func.coalesce(each, "") if has_objects else literal("")).label(each.name) for each in OF_ALERTS]
    else:
        now_ns = select(heartbeat.c.at_ns).scalar_subquery()
        goes_on = table.c.open & (now_ns > table.c.until_ns)
        begins, ends = table.c.since_ns, case((goes_on, now_ns), else_=table.c.until_ns).label("until_ns")
        columns = [ends if column.name == "until_ns" else column for column in columns]
    where: list[ColumnElement[bool]] = [
        table.c[name] == getattr(settings, name)
        for name in ("robot", "camera", "name", "site", "zone")
        if getattr(settings, name)
    ]
    if settings.since is not None:
        where.append(ends >= epoch_ns(settings.since))
    if settings.until is not None:
        where.append(begins <= epoch_ns(settings.until))
    return select(*columns).select_from(rows).where(*where).order_by(begins)


async def _batches(engine: AsyncEngine, settings: ExportSettings, table: Table) -> AsyncIterator[Sequence[Any]]:
    connection = await connect(engine, create=False)
    try:
        there = await connection.run_sync(lambda of: set(inspect(of).get_table_names()))
        if table.name not in there:  # it came later, and no monitor that knows it has run yet
            return
        query = query_of(settings, table, has_objects=alert_objects.name in there)
        result = await connection.stream(query, execution_options={"yield_per": ROWS})
        async for rows in result.mappings().partitions():
            yield rows
    finally:
        await connection.close()
