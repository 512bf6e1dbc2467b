"""The tables of the history. Times are nanoseconds since the epoch on the monitor's clock."""

from typing import Final

from sqlalchemy import BigInteger, Boolean, Column, Float, Index, Integer, MetaData, String, Table, Text, true

from schemas.header import MAX_LABEL

NAME: Final = String(64)
LABEL: Final = String(MAX_LABEL)

metadata: Final = MetaData()

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

open_intervals: Final = Index(
    "intervals_open", intervals.c.since_ns, postgresql_where=intervals.c.open, sqlite_where=intervals.c.open == true()
)
"""However long the history is, what goes on is found at once."""

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

acts: Final = Table(
    "acts",
    metadata,
    Column("alert_id", NAME, primary_key=True),
    Column("at_ns", BigInteger, primary_key=True),
    Column("state", String(16), primary_key=True),
    Column("who", NAME, nullable=False),
)
"""What people did with alerts."""

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
