"""Looking for a text in a database's names, in capitals or not, of any alphabet."""

from collections.abc import Sequence
from typing import Final

from sqlalchemy import ColumnElement, LargeBinary, and_, cast, func, or_, text
from sqlalchemy.ext.asyncio import AsyncConnection

from services.monitor.history.engine import CASEFOLD

ANY_LETTER: Final = "und-x-icu"
"""A collation of PostgreSQL's that knows the letters of all alphabets, whatever the database's own is."""


HAS_ANY_LETTER: Final = text("SELECT count(*) FROM pg_collation WHERE collname = :name")


BETWEEN: Final = "\x1f"
"""Between two names that are looked at together: that is several times as fast as one after the other."""


async def contains(
    connection: AsyncConnection, columns: Sequence[ColumnElement[str]], wanted: str
) -> ColumnElement[bool]:
    """Return what finds the rows with a text in one of some columns.

    Only names that have other letters than ASCII's take the slow way. PostgreSQL without ICU knows the letters of the
    database's own locale alone.
    """
    folded, column = wanted.casefold(), columns[0]
    for each in columns[1:]:
        column = column.concat(BETWEEN).concat(each)
    if connection.dialect.name == "sqlite":
        has_others = or_(*(func.length(each) < func.length(cast(each, LargeBinary)) for each in columns))
        others = func.instr(getattr(func, CASEFOLD)(column), folded) > 0
    else:
        has_others = or_(*(func.char_length(each) < func.octet_length(each) for each in columns))
        known = await connection.scalar(HAS_ANY_LETTER, {"name": ANY_LETTER})
        upper = func.upper(column.collate(ANY_LETTER) if known else column)  # SS of the German sz, as casefold ss
        others = upper.contains(folded.upper(), autoescape=True)
    found = and_(has_others, others)
    if folded.isascii():
        plain = func.instr if connection.dialect.name == "sqlite" else func.strpos
        found = or_(plain(func.lower(column), folded) > 0, found)
    return found
