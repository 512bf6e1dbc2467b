"""The tables of the history. Times are nanoseconds since the epoch on the monitor's clock."""

from collections.abc import Mapping
from typing import Any, Final

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Float,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    literal_column,
    true,
)

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
    """Return an index that finds open intervals at once, however long the history is."""
    return Index(
        f"{table.name}_open", table.c.since_ns, postgresql_where=table.c.open, sqlite_where=table.c.open == true()
    )


AT_CAMERA: Final = {"robot": NAME, "camera": NAME}
CLASS_AT_CAMERA: Final = {**AT_CAMERA, "name": LABEL}


def _interval_table(name: str, place: Mapping[str, String], *columns: Column[Any]) -> Table:
    """Return a table of intervals at a place: each lasts from since_ns to until_ns, and goes on while it is open.

    place: the columns that name one, the first of which is never empty but for what is of no place.
    """
    made = Table(
        name,
        metadata,
        *(Column(each, kind, primary_key=True) for each, kind in place.items()),
        Column("since_ns", BigInteger, primary_key=True),
        Column("until_ns", BigInteger, nullable=False),
        Column("open", Boolean, nullable=False),
        *columns,
        Index(f"{name}_by_end", "until_ns"),
    )
    _index_of_open(made)
    return made


def lasted(table: Table, since_ns: int) -> ColumnElement[bool]:
    """Return the condition for intervals that lasted until then, or are open."""
    return (table.c.until_ns >= since_ns) | table.c.open


intervals: Final = _interval_table(
    "intervals",
    CLASS_AT_CAMERA,
    Column("count", BigInteger, nullable=False),
    Column("score", Float, nullable=False),
    Column("closest_m", Float),
    Column("first_ns", BigInteger, nullable=False),
    Column("model", LABEL, nullable=False),
    Column("worker", LABEL, nullable=False),
)
"""Intervals in which one class was in view of one camera with one count.

open: it continues; until_ns is then the heartbeat's. first_ns: when the class came into view, with any count.
"""

open_intervals: Final = next(index for index in intervals.indexes if index.name == "intervals_open")

presence: Final = _interval_table("presence", AT_CAMERA, Column("heard_ns", BigInteger))
"""Intervals in which a robot's gateway was online or a camera was available; without a robot: one monitor led.

heard_ns: arrival of the camera's last class list before it fell silent.
"""

disagreements: Final = _interval_table(
    "disagreements",
    CLASS_AT_CAMERA,
    Column("count", BigInteger, nullable=False),
    Column("model", LABEL, nullable=False),
    Column("other_count", BigInteger, nullable=False),
    Column("other_model", LABEL, nullable=False),
)
"""Intervals in which two models counted a class of a camera differently. model: the primary one."""

stock: Final = _interval_table(
    "stock", {"site": NAME, "zone": NAME, "name": LABEL}, Column("count", BigInteger, nullable=False)
)
"""Intervals in which a zone held one number of objects of a class; see `StockLevel`."""

object_events: Final = _interval_table(
    "object_events",
    {"site": NAME, "object": NAME, "kind": NAME},
    Column("name", LABEL, nullable=False),
    Column("x", Float, nullable=False),
    Column("y", Float, nullable=False),
    Column("from_x", Float),
    Column("from_y", Float),
    Column("into", NAME, nullable=False),
    Column("by", NAME, nullable=False),
)
"""Events of the objects of sites; see `ObjectEvent`."""

poses: Final = Table(
    "poses",
    metadata,
    Column("robot", NAME, primary_key=True),
    Column("x", Float, nullable=False),
    Column("y", Float, nullable=False),
    Column("yaw", Float, nullable=False),
    Column("at_ns", BigInteger, nullable=False),
)
"""The last pose of each robot in the map: metres, and radians from its x axis."""

forgotten: Final = Table(
    "forgotten",
    metadata,
    Column("robot", NAME, primary_key=True),
    Column("at_ns", BigInteger, nullable=False),
)
"""When each robot was forgotten; one that was online since is listed again."""

clock_doubt: Final = Table(
    "clock_doubt",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("believed_ns", BigInteger, nullable=False),
    Column("doubted_ns", BigInteger, nullable=False),
    Column("trusted", Boolean, nullable=False),
)
"""One row while the monitor's clock is far from when history was kept last, else none: see `Doubt`.

trusted: an operator has confirmed the clock since.
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
"""One row: when all open intervals were last known to continue."""

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
"""Every alert in its current or final state."""

alert_objects: Final = Table(
    "alert_objects",
    metadata,
    Column("alert_id", NAME, primary_key=True),
    Column("site", NAME, nullable=False),
    Column("object", NAME, nullable=False),
)
"""The site, and the object if it is about one, of each alert about a site."""

UNRESOLVED: Final[ColumnElement[bool]] = alerts.c.state != literal_column("'resolved'")
"""The condition for unresolved alerts; without a parameter, so that databases use the index."""

open_alerts: Final = Index("alerts_open", alerts.c.changed_ns, postgresql_where=UNRESOLVED, sqlite_where=UNRESOLVED)
"""Finds unresolved alerts at once, however many were resolved."""

acts: Final = Table(
    "acts",
    metadata,
    Column("alert_id", NAME, primary_key=True),
    Column("at_ns", BigInteger, primary_key=True),
    Column("state", String(16), primary_key=True),
    Column("who", NAME, nullable=False),
)
"""Operators' actions on alerts."""

webhook_backlog: Final = Table(
    "webhook_backlog",
    metadata,
    Column("webhook", Text, primary_key=True),
    Column("alert_id", NAME, primary_key=True),
    Column("changed_ns", BigInteger, nullable=False),
)
"""Alerts that webhooks, by their names in the rule file, have not accepted yet."""

users: Final = Table(
    "users",
    metadata,
    Column("name", NAME, primary_key=True),
    Column("role", String(16), nullable=False),
    Column("password", Text, nullable=False),
    Column("changed_ns", BigInteger, nullable=False),
)
"""The users. password: argon2 hash."""

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
"""Sessions and tokens, valid until `until_ns`. digest: hexadecimal SHA-256 of the secret."""
