"""The tables of the history. Times are nanoseconds since the epoch on the monitor's clock."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final

from sqlalchemy import (
    CTE,
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Float,
    Index,
    Integer,
    MetaData,
    ScalarSelect,
    Select,
    String,
    Table,
    Text,
    and_,
    func,
    literal,
    literal_column,
    select,
    true,
    tuple_,
)
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Dialect

from schemas.header import MAX_LABEL

NAME: Final = String(64)
LABEL: Final = String(MAX_LABEL)

SCHEMA_VERSION: Final = 1
"""Of all these tables: one more with every change of one, since there is nothing that changes a database. A table that
is new and that others do without, as `forgotten`, is made where it is missing, and so is an index."""

metadata: Final = MetaData()

schema_version: Final = Table(
    "schema_version",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("number", Integer, nullable=False),
)
"""One row: the SCHEMA_VERSION of the fleetsight that made the tables."""


def _index_of_open(table: Table) -> Index:
    """However long the history is, what goes on is found at once."""
    return Index(
        f"{table.name}_open", table.c.since_ns, postgresql_where=table.c.open, sqlite_where=table.c.open == true()
    )


def lasted(table: Table, since_ns: int) -> ColumnElement[bool]:
    """Return the condition for intervals that lasted until then, or are open."""
    return (table.c.until_ns >= since_ns) | table.c.open


intervals: Final = Table(
    "intervals",
    metadata,
    Column("robot", NAME, primary_key=True),
    Column("camera", NAME, primary_key=True),
    Column("name", LABEL, primary_key=True),
    Column("since_ns", BigInteger, primary_key=True),
    Column("until_ns", BigInteger, nullable=False),
    Column("open", Boolean, nullable=False),
    Column("count", BigInteger, nullable=False),
    Column("score", Float, nullable=False),
    Column("closest_m", Float),
    Column("first_ns", BigInteger, nullable=False),
    Column("model", LABEL, nullable=False),
    Column("worker", LABEL, nullable=False),
    Index("intervals_by_end", "until_ns"),
)
"""As long as one class was in view of one camera with one count.

open: it goes on; until_ns is then the heartbeat's. first_ns: when the class came into view, with whatever count.
"""

open_intervals: Final = _index_of_open(intervals)

presence: Final = Table(
    "presence",
    metadata,
    Column("robot", NAME, primary_key=True),
    Column("camera", NAME, primary_key=True),
    Column("since_ns", BigInteger, primary_key=True),
    Column("until_ns", BigInteger, nullable=False),
    Column("open", Boolean, nullable=False),
    Column("heard_ns", BigInteger),
    Index("presence_by_end", "until_ns"),
)
"""As long as a robot's gateway was there, or a camera was spoken for; without a robot: as long as one monitor led.

heard_ns: when the last class list of a camera came before it was thought silent.
"""

_index_of_open(presence)

disagreements: Final = Table(
    "disagreements",
    metadata,
    Column("robot", NAME, primary_key=True),
    Column("camera", NAME, primary_key=True),
    Column("name", LABEL, primary_key=True),
    Column("since_ns", BigInteger, primary_key=True),
    Column("until_ns", BigInteger, nullable=False),
    Column("open", Boolean, nullable=False),
    Column("count", BigInteger, nullable=False),
    Column("model", LABEL, nullable=False),
    Column("other_count", BigInteger, nullable=False),
    Column("other_model", LABEL, nullable=False),
    Index("disagreements_by_end", "until_ns"),
)
"""As long as two models that looked at one camera counted a class differently; model: the one that spoke for it."""

_index_of_open(disagreements)

poses: Final = Table(
    "poses",
    metadata,
    Column("robot", NAME, primary_key=True),
    Column("x", Float, nullable=False),
    Column("y", Float, nullable=False),
    Column("yaw", Float, nullable=False),
    Column("at_ns", BigInteger, nullable=False),
)
"""Where each robot was last in the map: metres, and radians from its x axis."""

forgotten: Final = Table(
    "forgotten",
    metadata,
    Column("robot", NAME, primary_key=True),
    Column("at_ns", BigInteger, nullable=False),
)
"""When each robot that was gone for good was taken off every list; one that was there since is on them again."""

clock_doubt: Final = Table(
    "clock_doubt",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("believed_ns", BigInteger, nullable=False),
    Column("doubted_ns", BigInteger, nullable=False),
    Column("trusted", Boolean, nullable=False),
)
"""One row while the monitor's clock is far from when history was kept last, else none: see `Doubt`.

trusted: somebody said since that the clock is right.
"""

clock_correction: Final = Table(
    "clock_correction",
    metadata,
    Column("name", String(32), primary_key=True),
    Column("from_ns", BigInteger, primary_key=True),
    Column("ahead_ns", BigInteger, nullable=False),
    Column("next_ns", BigInteger, nullable=False),
)
"""The tables, by name, of which times from `from_ns` on are to be set back by `ahead_ns`: the clock was ahead.

Rows before `next_ns` are corrected already.
"""

heartbeat: Final = Table(
    "heartbeat",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("at_ns", BigInteger, nullable=False),
)
"""One row: when everything that is open was last known to go on."""

alerts: Final = Table(
    "alerts",
    metadata,
    Column("id", NAME, primary_key=True),
    Column("rule", LABEL, nullable=False),
    Column("severity", String(16), nullable=False),
    Column("state", String(16), nullable=False),
    Column("robot", NAME, nullable=False),
    Column("camera", NAME, nullable=False),
    Column("name", LABEL, nullable=False),
    Column("text", Text, nullable=False),
    Column("raised_ns", BigInteger, nullable=False),
    Column("changed_ns", BigInteger, nullable=False),
    Index("alerts_by_change", "changed_ns"),
)
"""Every alert as it stands or ended."""

UNRESOLVED: Final[ColumnElement[bool]] = alerts.c.state != literal_column("'resolved'")
"""What finds the alerts that are not resolved. No parameter, so that databases see that their index has them all."""

open_alerts: Final = Index("alerts_open", alerts.c.changed_ns, postgresql_where=UNRESOLVED, sqlite_where=UNRESOLVED)
"""However many alerts were resolved, those that were not are found at once."""

acts: Final = Table(
    "acts",
    metadata,
    Column("alert_id", NAME, primary_key=True),
    Column("at_ns", BigInteger, primary_key=True),
    Column("state", String(16), primary_key=True),
    Column("who", NAME, nullable=False),
)
"""What people did with alerts."""

webhook_backlog: Final = Table(
    "webhook_backlog",
    metadata,
    Column("webhook", Text, primary_key=True),
    Column("alert_id", NAME, primary_key=True),
    Column("changed_ns", BigInteger, nullable=False),
)
"""The alerts that webhooks, by the names of the rule file, did not take yet."""

users: Final = Table(
    "users",
    metadata,
    Column("name", NAME, primary_key=True),
    Column("role", String(16), nullable=False),
    Column("password", Text, nullable=False),
    Column("changed_ns", BigInteger, nullable=False),
)
"""Who may log in. password: its argon2 hash."""

logins: Final = Table(
    "logins",
    metadata,
    Column("digest", String(64), primary_key=True),
    Column("user", NAME, nullable=False),
    Column("kind", String(16), nullable=False),
    Column("user_ns", BigInteger, nullable=False),
    Column("until_ns", BigInteger, nullable=False),
    Index("logins_by_user", "user"),
)
"""Sessions and tokens that are good until then. digest: SHA-256, in hexadecimal, of what shows that one has it."""


@dataclass(frozen=True, slots=True)
class Upsert:
    """The statement that inserts or replaces rows of a table. values: of a row, in the statement's order."""

    statement: str
    values: Callable[[Mapping[str, Any]], tuple[Any, ...]]


def upsert_of(table: Table, dialect: Dialect) -> Upsert:
    """Return the upsert statement of a table with more than one column."""
    statement = (sqlite if dialect.name == "sqlite" else postgresql).insert(table)
    keys = [column.name for column in table.primary_key]
    others = {column.name: statement.excluded[column.name] for column in table.columns if column.name not in keys}
    compiled = statement.on_conflict_do_update(index_elements=keys, set_=others).compile(dialect=dialect)
    names = [column.name for column in table.columns] if compiled.positiontup is None else compiled.positiontup
    return Upsert(str(compiled), itemgetter(*names))


FOREVER_NS: Final = 2**63 - 1


def places_of(table: Table) -> CTE:
    """Return the places of a table, without those that name no robot, and one row of nulls.

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
