"""Streams rows to CSV, and CSV to Parquet."""

import csv
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TextIO

from sqlalchemy import Table

from services.monitor.formats import as_text, moment, rounded

TIME: Final = "_ns"
"""Suffix of nanosecond time columns; exported ones drop it and are UTC to the microsecond."""

AS_IN_JSON: Final = {"name": "class", "first_ns": "first_seen"}
"""Columns that have another name in the HTTP API: files use the API's."""


async def write_csv(
    batches: AsyncIterator[Sequence[Mapping[str, Any]]], table: Table, file: TextIO, *, for_people: bool
) -> int:
    """Write rows below a heading; return their number. for_people: formulas become text, for spreadsheets."""
    writer = csv.DictWriter(file, [exported_name(column.name) for column in table.columns])
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


def write_parquet(source: Path, target: Path, table: Table) -> None:
    """Convert a CSV file of a table's rows to Parquet."""
    import polars as pl  # noqa: PLC0415 - an extra, and only who wants Parquet needs it

    kinds = {str: pl.String, int: pl.Int64, float: pl.Float64, bool: pl.String}
    schema = {
        exported_name(column.name): pl.String if column.name.endswith(TIME) else kinds[column.type.python_type]
        for column in table.columns
    }
    times = [
        pl.col(exported_name(column.name)).str.to_datetime(time_unit="us", time_zone="UTC")
        for column in table.columns
        if column.name.endswith(TIME)
    ]
    flags = [
        pl.col(exported_name(column.name)) == "True" for column in table.columns if column.type.python_type is bool
    ]
    rows = pl.scan_csv(source, schema=schema).with_columns(pl.col(pl.String).fill_null(""))
    rows.with_columns(*times, *flags).sink_parquet(target)
