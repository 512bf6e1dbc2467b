"""The newest interval of each place, found without a look at any other: history is long, places are few."""

from typing import Any, Final

from sqlalchemy import CTE, BigInteger, ScalarSelect, Select, Table, and_, func, literal, select, tuple_

FOREVER_NS: Final = 2**63 - 1


def places_of(table: Table) -> CTE:
    """Return the places of a table, but for those of no robot, and one row of nulls.

    A place is all of the primary key but since_ns, its end. From each to the next it takes a step in the key's index.
    """
    names = [column.name for column in table.primary_key if column.name != "since_ns"]
    at = select(*(literal("").label(name) for name in names)).cte(recursive=True)
    later = table.alias()
    order = [*(later.c[name] for name in names), later.c.since_ns]
    last = [*(at.c[name] for name in names), literal(FOREVER_NS, BigInteger)]

    def of_next(name: str) -> ScalarSelect[Any]:
        found = select(later.c[name]).where(tuple_(*order) > tuple_(*last))
        return found.order_by(*order).limit(1).scalar_subquery()

    return at.union_all(select(*map(of_next, names)).where(at.c.robot.is_not(None)))


def newest_of_each(table: Table) -> Select[Any]:
    """Return a query for the newest interval of each place; see `places_of`."""
    at, others = places_of(table), table.alias()
    names = [column.name for column in at.c]
    newest = select(func.max(others.c.since_ns)).where(*(others.c[name] == at.c[name] for name in names))
    here = and_(*(table.c[name] == at.c[name] for name in names), table.c.since_ns == newest.scalar_subquery())
    return select(table).select_from(at).join(table, here).where(at.c.robot != "")
