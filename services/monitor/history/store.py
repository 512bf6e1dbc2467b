"""The database of the history: one writing connection, which also holds the leader's lock."""

import asyncio
import fcntl
import os
from collections import defaultdict
from collections.abc import AsyncIterator, Iterable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any, Final, Self, TypeVar

from sqlalchemy import ColumnElement, Row, Table, bindparam, func, select, text
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from schemas.alerts import Alert
from services.monitor.history.clock_trust import Correction, Doubt
from services.monitor.history.engine import (
    LEADER,
    TELL_NAME,
    OpenFiles,
    engine_of,
    file_of,
    lock_of,
    own_name,
    read_name,
    translating,
)
from services.monitor.history.interval_buffer import StoredInterval
from services.monitor.history.intervals import Interval
from services.monitor.history.opening import connect
from services.monitor.history.presence import Presence, PresenceKey
from services.monitor.history.row_maintenance import Pruning, begin_correcting, correct_some, shrink
from services.monitor.history.rows import (
    TABLES,
    Upsert,
    act_of_row,
    alert_of_row,
    interval_of_row,
    newest_of_each,
    pose_of_row,
    row_of_act,
    row_of_alert,
    row_of_alert_object,
    row_of_interval,
    row_of_pose,
    select_alerts,
    upsert_of,
)
from services.monitor.history.state import Act, HistoryError, StoredState
from services.monitor.history.tables import (
    UNRESOLVED,
    acts,
    alert_objects,
    alerts,
    clock_doubt,
    forgotten,
    heartbeat,
    intervals,
    poses,
    presence,
    webhook_backlog,
)
from services.monitor.inventory.member_limit import MAX_MEMBERS
from services.monitor.map.pose import Pose

LOCK: Final = 0x666C656574
"""The advisory lock's number: "fleet", as shown in pg_locks."""

UNHEARD_S: Final = 15.0
"""After how long without a word from who leads PostgreSQL lets go of the lock: of a machine that is gone none comes."""

END_UNHEARD: Final = text(
    "SELECT set_config(name, :after, false) FROM pg_settings"
    " WHERE name IN ('idle_session_timeout', 'idle_in_transaction_session_timeout')"
)
"""The former is there since PostgreSQL 14."""

MAX_LOADED: Final = 200_000

L = TypeVar("L", bound=StoredInterval)


class Store:
    """One connection to the database. Every method raises HistoryError, after which the store must be closed."""

    def __init__(self, engine: AsyncEngine, connection: AsyncConnection, files: OpenFiles | None) -> None:
        self._engine = engine
        self._connection = connection
        self._files = files
        self._lock: int | None = None
        self._upserts: dict[Table, Upsert] = {}
        self._pruning = Pruning()

    @classmethod
    async def open(cls, url: str, *, create: bool = True, complete: bool = False) -> Self:
        """Connect; see `connect`."""
        engine = engine_of(url)
        async with translating():
            files = None if (file := file_of(engine)) is None else await asyncio.to_thread(OpenFiles, file)
        store = cls(engine, await connect(engine, create=create, complete=complete), files)
        if files is not None:
            try:
                async with translating():
                    await asyncio.to_thread(files.opened)
            except BaseException:
                await store.close()
                raise
        return store

    async def lead(self) -> bool:
        """Become the leader, which writes and raises alerts, until closed; return False while another one leads."""
        async with self._at_hand():
            if self._files is not None:
                return self._lock is not None or self._lock_beside(self._files)
            taken = bool(await self._connection.scalar(select(func.pg_try_advisory_lock(LOCK))))
            if taken:
                await self._connection.execute(END_UNHEARD, {"after": f"{round(UNHEARD_S * 1_000)}ms"})
                await self._connection.execute(TELL_NAME, {"name": own_name()})
            await self._connection.commit()
            return taken

    async def leader(self) -> str:
        """Return the leader as host and process; empty if there is none or its name is unknown."""
        async with self._at_hand():
            if self._files is not None:
                return await asyncio.to_thread(read_name, lock_of(self._files.file))
            found = await self._connection.scalar(LEADER, {"lock": LOCK})
            await self._connection.commit()
            return found or ""

    async def load(self, since_ns: int) -> StoredState:
        """Return the open intervals and those that ended since then."""
        at_ns = await self.heartbeat_ns()
        going_on: list[StoredInterval] = []
        async with self._at_hand():
            for kind, table in TABLES.items():
                are_open = table.select().where(table.c.open).order_by(table.c.since_ns).limit(MAX_LOADED)
                going_on += [interval_of_row(kind, row, at_ns) for row in await self._connection.execute(are_open)]
            last = newest_of_each(intervals).where(intervals.c.open.is_(False), intervals.c.until_ns >= since_ns)
            last = last.order_by(intervals.c.until_ns.desc()).limit(MAX_LOADED)
            ended = [interval_of_row(Interval, row) for row in await self._connection.execute(last)]
            unresolved = select_alerts().where(UNRESOLVED).limit(MAX_LOADED)
            rows = (await self._connection.execute(unresolved)).all()
            found = [alert_of_row(row) for row in rows]
            theirs = acts.select().where(acts.c.alert_id.in_(unresolved.with_only_columns(alerts.c.id)))
            done = (await self._connection.execute(theirs.order_by(acts.c.at_ns).limit(MAX_LOADED))).all()
            waiting = select_alerts(webhook_backlog.c.webhook).join(
                webhook_backlog, alerts.c.id == webhook_backlog.c.alert_id
            )
            waiting = waiting.order_by(alerts.c.changed_ns).limit(MAX_LOADED)
            owed = [(row.webhook, alert_of_row(row)) for row in await self._connection.execute(waiting)]
            await self._connection.commit()
        in_view = [each for each in going_on if isinstance(each, Interval)]
        newest = {interval.place: interval for interval in [*ended, *in_view]}
        return StoredState(list(newest.values()), found, [act_of_row(row) for row in done], going_on, owed)

    async def last_present(self) -> Mapping[PresenceKey, int]:
        """Return until when each robot and each camera was present, as far as that is stored."""
        at_ns = await self.heartbeat_ns()
        async with self._at_hand():
            rows = (await self._connection.execute(newest_of_each(presence).limit(MAX_LOADED))).all()
            await self._connection.commit()
            every = [interval_of_row(Presence, row, at_ns) for row in rows]
            return {there.place: there.until_ns for there in every}

    async def known_alerts(self, ids: Iterable[str]) -> set[str]:
        """Return the ones of some alerts that are stored."""
        async with self._at_hand():
            found = await self._connection.scalars(select(alerts.c.id).where(alerts.c.id.in_(list(ids))))
            known = set(found)
            await self._connection.commit()
            return known

    async def heartbeat_ns(self) -> int:
        """Return the time of the last write; 0 if there was none."""
        async with self._at_hand():
            found = await self._connection.scalar(select(heartbeat.c.at_ns))
            await self._connection.commit()
            return found or 0

    async def select(self, kind: type[L], *where: ColumnElement[bool], since_ns: int = 0) -> list[L]:
        """Return the newest MAX_LOADED intervals that lasted until then, or until the heartbeat; oldest first."""
        at_ns = await self.heartbeat_ns()
        table = TABLES[kind]
        ended = table.c.open.is_(False) & (table.c.until_ns >= since_ns)
        rows: list[Row[Any]] = []
        async with self._at_hand():  # the newest of either are found in an index of their own
            for of, ends in ((table.c.open, table.c.since_ns), (ended, table.c.until_ns)):
                query = table.select().where(*where, of).order_by(ends.desc()).limit(MAX_LOADED - len(rows))
                rows += (await self._connection.execute(query)).all()
            await self._connection.commit()
            return sorted((interval_of_row(kind, row, at_ns) for row in rows), key=lambda each: each.since_ns)

    async def poses(self, since_ns: int) -> dict[str, Pose]:
        """Return the poses of robots that are of then, or newer."""
        async with self._at_hand():
            newest = poses.select().where(poses.c.at_ns >= since_ns).order_by(poses.c.at_ns.desc()).limit(MAX_MEMBERS)
            rows = (await self._connection.execute(newest)).all()
            await self._connection.commit()
            return dict(map(pose_of_row, rows))

    async def owe(self, waiting: Iterable[tuple[str, Alert]], taken: Iterable[tuple[str, str]]) -> None:
        """Write the alerts that webhooks, by name, have not accepted yet; delete others, by webhook name and id."""
        rows = [{"webhook": name, "alert_id": alert.id, "changed_ns": alert.changed_ns} for name, alert in waiting]
        at = webhook_backlog.c
        these = webhook_backlog.delete().where(at.webhook == bindparam("of"), at.alert_id == bindparam("id_"))
        async with self._at_hand(), self._connection.begin():
            await self._put(webhook_backlog, rows)
            if gone := [{"of": name, "id_": alert_id} for name, alert_id in taken]:
                await self._connection.execute(these, gone)

    async def write_poses(self, some: Mapping[str, Pose]) -> None:
        """Write robots' poses."""
        async with self._at_hand(), self._connection.begin():
            await self._put(poses, [row_of_pose(robot, pose) for robot, pose in some.items()])

    async def forgotten(self, since_ns: int = 0) -> dict[str, int]:
        """Return the robots that were forgotten after then, and when."""
        async with self._at_hand():
            newest = forgotten.select().where(forgotten.c.at_ns > since_ns).order_by(forgotten.c.at_ns.desc())
            rows = (await self._connection.execute(newest.limit(MAX_MEMBERS))).all()
            await self._connection.commit()
            return {row.robot: row.at_ns for row in rows}

    async def forget(self, robots: Mapping[str, int]) -> None:
        """Write when robots were forgotten."""
        async with self._at_hand(), self._connection.begin():
            await self._put(forgotten, [{"robot": robot, "at_ns": at_ns} for robot, at_ns in robots.items()])

    async def write(
        self,
        some: Iterable[StoredInterval],
        changed: Iterable[Alert] = (),
        at_ns: int | None = None,
        done: Iterable[Act] = (),
    ) -> None:
        """Write intervals, alerts and actions atomically, with the heartbeat at `at_ns`."""
        of_kind: dict[type[StoredInterval], list[StoredInterval]] = defaultdict(list)
        for each in some:
            of_kind[type(each)].append(each)
        async with self._at_hand(), self._connection.begin():
            for kind, those in of_kind.items():
                await self._put(TABLES[kind], map(row_of_interval, those))
            changed = list(changed)
            await self._put(alerts, [row_of_alert(alert) for alert in changed])
            await self._put(alert_objects, [row_of_alert_object(alert) for alert in changed if alert.site])
            await self._put(acts, [row_of_act(act) for act in done])
            await self._put(heartbeat, [] if at_ns is None else [{"id": 1, "at_ns": at_ns}])

    async def clock_doubt(self) -> tuple[Doubt | None, bool]:
        """Return why the clock was doubted, None if it was not, and whether an operator has trusted it since."""
        async with self._at_hand():
            row = (await self._connection.execute(clock_doubt.select())).one_or_none()
            await self._connection.commit()
            return (None, False) if row is None else (Doubt(row.believed_ns, row.doubted_ns), row.trusted)

    async def write_clock_doubt(self, doubt: Doubt) -> None:
        """Write that the clock is doubted."""
        row = {"id": 1, "believed_ns": doubt.believed_ns, "doubted_ns": doubt.doubted_ns, "trusted": False}
        async with self._at_hand(), self._connection.begin():
            await self._put(clock_doubt, [row])

    async def trust_clock(self) -> bool:
        """Write that the clock is right; return False if no monitor doubted it."""
        async with self._at_hand(), self._connection.begin():
            return bool((await self._connection.execute(clock_doubt.update().values(trusted=True))).rowcount)

    async def end_clock_doubt(self, correction: Correction | None) -> None:
        """Write that the clock is believed, and what `correct` is to correct, as it was kept by one that was ahead."""
        async with self._at_hand(), self._connection.begin():
            await self._connection.execute(clock_doubt.delete())
            if correction is not None:
                await begin_correcting(self._connection, correction)

    async def correct(self) -> bool:
        """Correct some of what was kept by a clock that was ahead; return False if there was nothing to correct."""
        async with self._at_hand(), self._connection.begin():
            return await correct_some(self._connection)

    async def prune(self, before_ns: int) -> bool:
        """Delete rows that ended before then, about SLICE of a kind at a time; return whether all are deleted.

        Each kind has a transaction, and the time for it, of its own.
        """
        whole = True
        for step in self._pruning.steps(before_ns):
            async with self._at_hand(), self._connection.begin():
                whole &= await step(self._connection)
        if self._files is not None:
            async with self._at_hand():
                whole &= await shrink(self._connection)
                await self._connection.commit()
        return whole

    async def interrupt(self) -> bool:
        """Have SQLite fail at what it does now, as a statement whose task is cancelled goes on; False for others."""
        if self._files is not None and not (self._connection.closed or self._connection.invalidated):
            driver: Any = (await self._connection.get_raw_connection()).driver_connection
            await driver.interrupt()
        return self._files is not None

    async def close(self) -> None:
        """Close the connection and release the lock; raises nothing."""
        with suppress(HistoryError):
            async with translating():
                await self._connection.close()
        with suppress(HistoryError):
            async with translating():
                await self._engine.dispose()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    @asynccontextmanager
    async def _at_hand(self) -> AsyncIterator[None]:
        """Translate errors, and make one of it that the files were moved, before or just now: nothing is kept then."""
        async with translating():
            await self._check()
            yield
            await self._check()

    async def _check(self) -> None:
        if self._files is not None:
            await asyncio.to_thread(self._files.check)

    def _lock_beside(self, files: OpenFiles) -> bool:
        """Lock a file beside the database: opening and closing the database itself would release SQLite's own locks."""
        lock = lock_of(files.file)
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return False
        self._lock = descriptor
        files.locked(lock, descriptor)
        os.ftruncate(descriptor, 0)
        os.write(descriptor, own_name().encode())
        return True

    async def _put(self, table: Table, rows: Iterable[Mapping[str, Any]]) -> None:
        upsert = self._upserts.get(table)
        if upsert is None:
            upsert = self._upserts[table] = upsert_of(table, self._engine.dialect)
        if values := [upsert.values(row) for row in rows]:
            await self._connection.exec_driver_sql(upsert.statement, values)
