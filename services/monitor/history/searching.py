"""Looking for a text in a database's names, in capitals or not, of any alphabet."""

from typing import Final

from sqlalchemy import ColumnElement, and_, func, or_, text
from sqlalchemy.ext.asyncio import AsyncConnection

from services.monitor.history.engine import CASEFOLD

ANY_LETTER: Final = "und-x-icu"
"""A collation of PostgreSQL's that knows the letters of all alphabets, whatever the database's own is."""


HAS_ANY_LETTER: Final = text("SELECT count(*) FROM pg_collation WHERE collname = :name")


async def contains(connection: AsyncConnection, column: ColumnElement[str], wanted: str) -> ColumnElement[bool]:
    """Return what finds the rows with a text in a column.

    Only names that have other letters than ASCII's take the slow way. PostgreSQL without ICU knows the letters of the
    database's own locale alone.
    """
    folded = wanted.casefold()
    if connection.dialect.name == "sqlite":
        has_others: ColumnElement[bool] = column.op("GLOB", is_comparison=True)("*[^\x01-\x7f]*")
        others = getattr(func, CASEFOLD)(column).contains(folded, autoescape=True)
    else:
        has_others = func.octet_length(column) > func.char_length(column)
        known = await connection.scalar(HAS_ANY_LETTER, {"name": ANY_LETTER})
        upper = func.upper(column.collate(ANY_LETTER) if known else column)  # SS of the German sz, as casefold ss
        others = upper.contains(folded.upper(), autoescape=True)
    return or_(column.icontains(folded, autoescape=True), and_(has_others, others))
