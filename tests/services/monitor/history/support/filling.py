"""Long histories for tests, made by the database itself."""

from typing import Final

from sqlalchemy import text

from services.monitor.history.store import Store
from tests.services.monitor.inventory.seeing import S

ROBOTS: Final = 20

NUMBERS: Final = "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i < :most - 1)"
"""0 to `most` - 1."""

PLACE: Final = "'r' || (i % :robots), 'front'"
KIND: Final = "CASE i / :robots % 3 WHEN 0 THEN 'box' WHEN 1 THEN 'pallet' ELSE 'forklift' END"

ALERT: Final = "'alert-of-a-long-history-' || i"
"""About as long as those that are made."""

STATEMENTS: Final = {
    "intervals": "SELECT :place, :kind, :from + i * :step, :from + i * :step + :long, false, i % 5 + 1, 0.5, 1.25,"
    " :from + i * :step, 'm', 'w' FROM n",
    "presence": "SELECT 'r' || (i % :robots), CASE i / :robots % 2 WHEN 0 THEN 'front' ELSE '' END,"
    " :from + i * :step, :from + i * :step + :long, false, NULL FROM n",
    "disagreements": "SELECT :place, :kind, :from + i * :step, :from + i * :step + :long, false, 1, 'm', 2, 'n' FROM n",
    "stock": "SELECT 'hall', 'zone ' || (i % :robots), :kind, :from + i * :step, :from + i * :step + :long, false,"
    " i % 5 FROM n",
    "object_events": "SELECT 'hall', 'o' || (i % 20000), 'moved', :from + i * :step, :from + i * :step, false, :kind,"
    " 1.5, 2.5, 3.5, 4.5, '', 'r1' FROM n",
    "alerts": "SELECT :alert, 'near', 'warning', CASE i % 100 WHEN 0 THEN 'raised' ELSE 'resolved' END,"
    " :place, 'box', 'box is near', :from + i * :step, :from + i * :step + :long FROM n",
    "acts": "SELECT :alert, :from + i * :step, 'acknowledged', 'ann' FROM n",
    "forgotten": "SELECT 'gone' || i, :from + i * :step FROM n",
    "poses": "SELECT 'r' || i, 1.5, 2.5, 0.5, :from + i * :step FROM n",
}
"""Of the tables' columns, in order."""


async def fill(store: Store, table: str, count: int, from_s: int, until_s: int) -> None:
    """Fill a table evenly with what was so between two times; what lasts does so for a third of the time at a place."""
    step_ns = (until_s - from_s) * S // count
    parts = {"place": PLACE, "kind": KIND, "alert": ALERT}
    values = {"robots": ROBOTS, "most": count, "from": from_s * S, "step": step_ns, "long": step_ns * ROBOTS}
    insert = " ".join((NUMBERS, "INSERT INTO", table, STATEMENTS[table]))
    for name, value in {**parts, **values}.items():  # types of parameters would have to be told
        insert = insert.replace(f":{name}", str(value))
    async with store._connection.begin():
        await store._connection.execute(text(insert))
        await store._connection.execute(text(f"ANALYZE {table}"))
