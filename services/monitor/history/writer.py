"""Writes the history off the message path, so that monitoring continues if the database is slow or fails."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from typing import Final

from schemas.alerts import Alert
from services.monitor.event_loop.blocking_calls import uninterrupted
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.history.clock_trust import Correction
from services.monitor.history.engine import translating
from services.monitor.history.interval_buffer import IntervalBuffer
from services.monitor.history.intervals import Disagreements, Interval, PauseTracker, Sightings
from services.monitor.history.presence import RESTORED_NS, WRITE_S, Attendance, KnownPoses, Presence
from services.monitor.history.settings import NONE, HistorySettings
from services.monitor.history.state import (
    Act,
    Acts,
    HistoryError,
    HistoryStatus,
    OtherVersionError,
    PendingAlerts,
    StoredState,
    resolved,
)
from services.monitor.history.store import UNHEARD_S, Store
from services.monitor.history.upkeep import Upkeep
from services.monitor.history.webhook_backlog import BacklogWriter, NoBacklog, WebhookBacklog
from services.monitor.history.world_history import WorldHistory
from services.monitor.inventory.inventory import Inventory
from services.monitor.inventory.sighting import NS, Change
from services.monitor.map.last_seen import FORGET_NS, SightingMap
from services.monitor.world.site_objects import World
from services.monitor.world.site_status import Sites

log = logging.getLogger(__name__)

FLUSH_S: Final = 0.5
"""Seconds between two writes; a kill loses at most twice that."""

NOTE_S: Final = 0.5
"""Seconds between two checks of presence and disagreements."""

RETRY_S: Final = 1.0
FIRST_GO_S: Final = 3.0
"""Time for which a database that is back is left to its previous leader, which knows the newest state of alerts."""

RESTORE_S: Final = 5.0
"""Maximum time for which a slow database delays the start of a monitor."""

BATCH: Final = 250
"""Rows of one transaction; making each of them blocks the event loop for some microseconds."""

FOLLOWED_NS: Final = 2 * round(UNHEARD_S) * NS
"""Maximum age of changes that a leader may have left unwritten: it may have died without notice."""


class HistoryWriter:
    """Writes inventory changes, alerts and robots' poses to the database of the settings.

    on_lead: is called with the alerts that are not resolved, what people did with these, and when alerts were written
    last, epoch nanoseconds, whenever this monitor becomes the one that raises alerts.
    owing: posts alerts to webhooks. world: the sites whose objects it keeps.
    acts: what people did with alerts lately, and with those that are not resolved.
    """

    def __init__(
        self,
        settings: HistorySettings,
        inventory: Inventory,
        on_lead: Callable[[Sequence[Alert], Sequence[Act], int], None] = lambda *_: None,
        places: SightingMap | None = None,
        owing: WebhookBacklog | None = None,
        *,
        world: tuple[World, Sites] | None = None,
    ) -> None:
        self._settings = settings
        self._inventory = inventory
        self._on_lead = on_lead
        self._buffer = IntervalBuffer()
        self._sightings = Sightings(self._buffer)
        self._attendance = Attendance(inventory, self._buffer)
        self._disagreements = Disagreements(inventory, self._buffer)
        self._world = WorldHistory(self._buffer, *(world or (World(on=False), Sites())))
        self._poses = KnownPoses(places or SightingMap())
        self._poses_due_s = time.monotonic() + WRITE_S
        self._alerts = PendingAlerts()
        self.acts = Acts()
        self._forgotten: dict[str, int] = {}
        self._heeded_ns = time.time_ns()
        self._pauses = PauseTracker(inventory, self._sightings)
        self._store: Store | None = None
        self._problem = ""
        self._leads = settings.history == NONE
        self._leader = ""
        self._had = self._writes = self._asked = self._follows = self._loaded = False
        self._may_lead_s = 0.0
        self._owed = BacklogWriter(owing or NoBacklog())
        self._upkeep = Upkeep(settings.history, settings.history_days)

    @property
    def status(self) -> HistoryStatus:
        """The status of the history."""
        another_leads = self._follows and not self._problem
        pending = 0 if another_leads else len(self._buffer) + len(self._alerts)
        warnings = () if another_leads else self._upkeep.problems()
        return HistoryStatus(self._problem, self._leads, pending, self._buffer.lost, self._leader, warnings)

    def take(self, changes: Iterable[Change]) -> None:
        """Take a change of the inventory."""
        if self._settings.history != NONE:
            self._sightings.take(changes)

    def alert(self, alert: Alert) -> None:
        """Take a changed alert."""
        if self._settings.history != NONE:
            self._alerts.put(alert)

    def act(self, act: Act) -> None:
        """Take an operator's action on an alert."""
        self.acts.take([act])
        if self._settings.history != NONE:
            self._alerts.put_act(act)

    def forget(self, robot: str) -> None:
        """Take that a robot was forgotten."""
        if self._settings.history != NONE:
            self._forgotten[robot] = self._heeded_ns = max(self._heeded_ns + 1, time.time_ns())
            self._attendance.note_gone(robot, self._heeded_ns)

    def trust_clock(self) -> None:
        """Trust this machine's clock, however long ago the history was written last."""
        self._upkeep.trust_clock()

    async def restore(self) -> None:
        """Restore the inventory from the database; call it before any other method.

        Raises:
            OtherVersionError: the database is another version's. One that cannot be had is waited for.
        """
        if self._settings.history == NONE:
            self._on_lead((), (), time.time_ns())
            return
        try:
            await self._restore()
        except BaseException:  # nothing calls `run` then, which would close it at its end
            await self._close()
            raise

    async def _restore(self) -> None:
        try:
            async with translating(RESTORE_S):
                self._store = await Store.open(self._settings.history)
                since_ns = time.time_ns() - RESTORED_NS
                kept, there = await self._store.load(since_ns), await self._store.last_present()
                heartbeat_ns = await self._store.heartbeat_ns()
                poses = await self._store.poses(time.time_ns() - FORGET_NS)
                forgotten = await self._store.forgotten()
        except OtherVersionError:
            raise
        except HistoryError as error:
            await self._fail(error)
            return
        self._inventory.restore(interval.sighting() for interval in kept.intervals)
        now_ns = time.time_ns()  # by which nobody was there later, whatever another clock said
        self._inventory.recall({of: min(at_ns, now_ns) for of, at_ns in there.items()}, min(since_ns, heartbeat_ns))
        self._heed({of: at_ns for of, at_ns in forgotten.items() if at_ns >= there.get((of, ""), 0)})
        self._poses.restore(poses)
        self._buffer.adopt(kept.intervals)

    async def run(self) -> None:
        """Write the history until cancelled, then write pending rows."""
        if self._settings.history == NONE:
            return
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._watch())
                group.create_task(self._upkeep.run())
                while True:
                    wait_s = await uninterrupted(self._attempt())
                    await asyncio.sleep(wait_s)
        finally:
            await self._end()

    async def _watch(self) -> None:
        """Note presence, disagreements and sites, whether the database is available or not."""
        while True:
            now_ns = time.time_ns()
            noted = (each.note(now_ns) for each in (self._attendance, self._disagreements, self._world))
            async for _ in in_turns(chain.from_iterable(noted)):
                pass
            await asyncio.sleep(NOTE_S)

    async def _attempt(self) -> float:
        """Write pending rows; return the seconds until the next attempt."""
        try:
            if self._store is None:
                # a missing file is waited for: it may be moved back, and a new one has no users
                self._store = await Store.open(self._settings.history, create=not self._had, complete=True)
                if self._follows and self._problem:
                    self._may_lead_s = time.monotonic() + FIRST_GO_S
            self._heed(await self._store.forgotten(self._heeded_ns))
            if not self._writes:
                await self._take_the_lead(self._store)
            await self._flush(self._store)
        except HistoryError as error:
            await self._fail(error)
            return RETRY_S
        if self._problem:
            log.info("history is kept again")
            self._problem = ""
        return FLUSH_S

    async def _take_the_lead(self, store: Store) -> None:
        leads = time.monotonic() >= self._may_lead_s and await store.lead()
        self._leader = "" if leads else await store.leader()
        self._asked, self._follows = True, not leads
        if leads:
            await self._go_on(store)
        else:
            self._leads = False
            self._attendance.follow()
            self._buffer.forget_pending(time.time_ns() - FOLLOWED_NS)
            await self._hand_over(store)

    async def _hand_over(self, store: Store) -> None:
        """Write what people did while this monitor alone thought that it led, and that the alerts are over it raised.

        The new leader raises the conditions that still hold, and decides about its own alerts.
        """
        forgotten, self._forgotten = self._forgotten, {}
        for robot in filter(self._inventory.is_forgotten, forgotten):
            self.forget(robot)  # with a time that is news to others
        await self._write_forgotten(store)
        changed, acts = self._alerts.snapshot()
        if changed or acts:
            theirs = await store.known_alerts(changed)
            over = [resolved(alert, time.time_ns()) for name, alert in changed.items() if name not in theirs]
            await store.write([], over, None, acts)
            self._alerts.written(changed, acts)

    def _heed(self, forgotten: Mapping[str, int]) -> None:
        """Forget the robots that were forgotten at another monitor, or at this one before."""
        self._heeded_ns = max([self._heeded_ns, *forgotten.values()])
        for robot in forgotten.keys() - self._inventory.robots():
            self._inventory.forget(robot)

    async def _go_on(self, store: Store) -> None:
        """Continue where the previous writer stopped."""
        if not await self._upkeep.correct(store):
            return
        await self._upkeep.begin(store)
        gap_ns, heartbeat_ns = self._inventory.limits.lost_ns, await store.heartbeat_ns()
        kept: StoredState = await store.load(heartbeat_ns - gap_ns)
        now_ns, ended = time.time_ns(), [each for each in kept.intervals if not each.open]
        stored = [*kept.going_on, *ended]
        self._buffer.merge(stored, heartbeat_ns, gap_ns, followed=not self._leads, ended_of=Interval)
        self._pauses.begin_anew()
        if not self._loaded and now_ns - heartbeat_ns <= gap_ns:
            self._attendance.resume((each for each in kept.going_on if isinstance(each, Presence)), now_ns)
        self.acts.take(kept.acts)
        led = self._leads and self._loaded
        if not led:
            self._lead(kept.alerts, kept.acts, heartbeat_ns)
        self._owed.begin(kept.owed, leads=led)
        self._writes = self._loaded = True

    def _lead(self, alerts: Sequence[Alert], acts: Sequence[Act], since_ns: int) -> None:
        if not self._leads:
            self._attendance.lead(time.time_ns())
        self._leads = True
        self._on_lead(alerts, acts, since_ns)

    async def _flush(self, store: Store) -> None:
        if not self._writes:
            return
        now_ns = time.time_ns()
        if (correction := await self._upkeep.check_clock(store, now_ns)) is not None:
            self._correct(correction, now_ns)
        if not await self._upkeep.correct(store):
            return
        self._pauses.note(now_ns)
        for _ in range(len(self._buffer) // BATCH):
            some = self._buffer.pending(BATCH)
            await store.write(some)
            self._buffer.written(some)
        owed = self._owed.snapshot()
        some, (changed, acts) = self._buffer.pending(BATCH), self._alerts.snapshot()
        await store.write(some, changed.values(), now_ns, acts)
        self._buffer.written(some)
        self._alerts.written(changed, acts)
        await self._write_forgotten(store)
        await self._owed.write(store, owed)
        if time.monotonic() >= self._poses_due_s:
            await self._write_poses(store)

    def _correct(self, correction: Correction, now_ns: int) -> None:
        """Correct what is not written yet as it is corrected in the database."""
        of = correction.corrected
        self._inventory.set_back(now_ns)
        self._buffer.correct(of)
        self._alerts.correct(of)
        self.acts.correct(of)
        self._forgotten = {robot: of(at_ns) for robot, at_ns in self._forgotten.items()}
        self._heeded_ns = of(self._heeded_ns)

    async def _write_poses(self, store: Store) -> None:
        self._poses_due_s = time.monotonic() + WRITE_S
        some = [each async for each in in_turns(self._poses.pending())]
        for first in range(0, len(some), BATCH):
            batch = dict(some[first : first + BATCH])
            await store.write_poses(batch)
            self._poses.written(batch)

    async def _write_forgotten(self, store: Store) -> None:
        if forgotten := dict(self._forgotten):
            await store.forget(forgotten)
            self._forgotten = dict(self._forgotten.items() - forgotten.items())

    async def _fail(self, error: HistoryError) -> None:
        if str(error) != self._problem:
            log.warning("history is not kept: %s", error)
        if not self._asked:
            self._asked = True
            self._lead((), (), time.time_ns())
        self._problem, self._writes = str(error), False
        await self._close()

    async def _close(self) -> None:
        self._upkeep.pause()
        store, self._store = self._store, None
        if store is not None:
            self._had = True
            await store.close()

    async def _end(self) -> None:
        if self._store is None:
            return
        try:
            if self._writes:
                await self._flush(self._store)
                await self._write_poses(self._store)
        except HistoryError as error:
            log.warning("the end of the history was not kept: %s", error)
        finally:
            await self._close()
