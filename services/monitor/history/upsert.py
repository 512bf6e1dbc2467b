"""Statements that write rows, made once: making one for each row costs more than writing it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from sqlalchemy import Table
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Dialect


@dataclass(frozen=True, slots=True)
class Upsert:
    """What writes rows of a table, over those that are there. values: of a row, as the statement has them."""

    statement: str
    values: Callable[[Mapping[str, Any]], tuple[Any, ...]]


def upsert_of(table: Table, dialect: Dialect) -> Upsert:
    """Return what writes rows of a table of more than one column."""
    statement = (sqlite if dialect.name == "sqlite" else postgresql).insert(table)
    keys = [column.name for column in table.primary_key]
    others = {column.name: statement.excluded[column.name] for column in table.columns if column.name not in keys}
    compiled = statement.on_conflict_do_update(index_elements=keys, set_=others).compile(dialect=dialect)
    names = [column.name for column in table.columns] if compiled.positiontup is None else compiled.positiontup
    return Upsert(str(compiled), itemgetter(*names))
