"""Rows are inserted or replaced."""

import sqlite3
from contextlib import closing

from services.monitor.history.engine import engine_of
from services.monitor.history.rows import upsert_of
from services.monitor.history.tables import heartbeat, intervals

COLUMNS = tuple(column.name for column in intervals.columns)
ROW = {name: number for number, name in enumerate(COLUMNS)}


def test_a_row_is_written_over_the_one_with_its_key() -> None:
    upsert = upsert_of(intervals, engine_of("sqlite://").dialect)
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute(f"create table intervals ({', '.join(COLUMNS)}, unique (robot, camera, name, since_ns))")
        for row in (ROW, {**ROW, "count": 9}, {**ROW, "robot": "other"}):
            database.execute(upsert.statement, upsert.values(row))
        found = database.execute("select * from intervals order by rowid").fetchall()
    assert found == [tuple({**ROW, "count": 9}.values()), tuple({**ROW, "robot": "other"}.values())]


def test_another_database_takes_the_values_in_its_own_way() -> None:
    upsert = upsert_of(heartbeat, engine_of("postgresql://somebody@localhost/fleetsight").dialect)
    assert "VALUES ($1::INTEGER, $2::BIGINT) ON CONFLICT (id)" in upsert.statement
    assert upsert.values({"at_ns": 2, "id": 1}) == (1, 2)
