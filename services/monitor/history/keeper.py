"""Keep the history, off the path of the messages: whatever the database does, monitoring goes on."""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import chain
from typing import Final

from msgspec.structs import replace

from schemas.alerts import Alert, AlertState
from services.monitor.history.acts import Act, Acts
from services.monitor.history.disagreements import Disagreements
from services.monitor.history.engine import translating
from services.monitor.history.errors import HistoryError, OtherVersionError
from services.monitor.history.intervals import Sightings
from services.monitor.history.ledger import Lasting, Ledger
from services.monitor.history.poses import WRITE_S, KnownPoses
from services.monitor.history.presence import RESTORED_NS, Attendance, Presence
from services.monitor.history.settings import NONE, HistorySettings
from services.monitor.history.store import UNHEARD_S, Kept, Store
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.debouncing import NS
from services.monitor.inventory.inventory import Inventory
from services.monitor.inventory.sighting import Change
from services.monitor.inventory.speaking import Speaking
from services.monitor.mapping.places import FORGET_NS, Places
from services.monitor.turns import in_turns

log = logging.getLogger(__name__)

FLUSH_S: Final = 0.5
"""How long what changed waits to be written; twice that is the most that a kill loses."""

NOTE_S: Final = 0.5
"""How often it is noted who came and went, and what models disagree about."""

RETRY_S: Final = 1.0
FIRST_GO_S: Final = 3.0
"""How long a database that is back is left to whoever led until it was gone: they know what became of alerts since."""

RESTORE_S: Final = 5.0
"""How long the database may keep a monitor from beginning."""

PRUNE_S: Final = 3_600.0
BATCH: Final = 250
"""Rows of one transaction: what makes them of intervals holds up everything else for some microseconds each."""

FOLLOWED_NS: Final = 2 * round(UNHEARD_S) * NS
"""How long ago something may have ended that whoever leads has not written: it may be gone without a word."""

DAY_NS: Final = 86_400 * NS
MAX_ALERTS: Final = 10_000


@dataclass(frozen=True, slots=True)
class HistoryStatus:
    """How the history is doing.

    problem: why it is not being kept, in words, or empty. leads: this monitor is the one that raises alerts; while the
    database cannot be asked, that stays as it was, and whoever never could ask it raises them.
    pending: what waits to be written, none while another one leads. lost: intervals given up because too many waited.
    leader: who else leads, as host and process, as far as that is known.
    """

    problem: str
    leads: bool
    pending: int
    lost: int
    leader: str = ""


class HistoryKeeper:
    """Writes what changes in the inventory, alerts, and where robots are, to the database of the settings.

    on_lead: is called with the alerts that are not resolved, and what people did with these, whenever this monitor
    becomes the one that raises alerts.
    acts: what people did with alerts lately, and with those that are not resolved.
    """

    def __init__(
        self,
        settings: HistorySettings,
        inventory: Inventory,
        on_lead: Callable[[Sequence[Alert], Sequence[Act]], None] = lambda *_: None,
        places: Places | None = None,
    ) -> None:
        self._settings = settings
        self._inventory = inventory
        self._on_lead = on_lead
        self._ledger = Ledger()
        self._sightings = Sightings(self._ledger)
        self._attendance = Attendance(inventory, self._ledger)
        self._disagreements = Disagreements(inventory, self._ledger)
        self._poses = KnownPoses(places or Places())
        self._poses_due_s = time.monotonic() + WRITE_S
        self._alerts: dict[str, Alert] = {}
        self.acts = Acts()
        self._new_acts: deque[Act] = deque(maxlen=MAX_ALERTS)
        self._forgotten: dict[str, int] = {}
        self._heeded_ns = time.time_ns()
        self._speaking = self._new_speaking()
        self._store: Store | None = None
        self._had = False
        self._problem = ""
        self._writes = False
        self._leads = settings.history == NONE
        self._leader = ""
        self._asked = False
        self._follows = False
        self._may_lead_s = 0.0
        self._loaded = False
        self._due_s = 0.0

    @property
    def status(self) -> HistoryStatus:
        """How it is doing."""
        another_leads = self._follows and not self._problem
        pending = 0 if another_leads else len(self._ledger) + len(self._alerts)
        return HistoryStatus(self._problem, self._leads, pending, self._ledger.lost, self._leader)

    def take(self, changes: Iterable[Change]) -> None:
        """Take what changed in the inventory."""
        if self._settings.history != NONE:
            self._sightings.take(changes)

    def alert(self, alert: Alert) -> None:
        """Take an alert that changed."""
        if self._settings.history != NONE:
            self._alerts[alert.id] = alert
            while len(self._alerts) > MAX_ALERTS:
                del self._alerts[next(iter(self._alerts))]

    def act(self, act: Act) -> None:
        """Take what somebody did with an alert."""
        self.acts.take([act])
        if self._settings.history != NONE:
            self._new_acts.append(act)

    def forget(self, robot: str) -> None:
        """Take that a robot was forgotten."""
        if self._settings.history != NONE:
            self._forgotten[robot] = self._heeded_ns = max(self._heeded_ns + 1, time.time_ns())
            self._attendance.note_gone(robot, self._heeded_ns)

    async def restore(self) -> None:
        """Give the inventory back what the database kept of it; before anything is taken.

        Raises:
            OtherVersionError: the database is another version's. One that cannot be had is waited for.
        """
        if self._settings.history == NONE:
            self._on_lead((), ())
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
        self._inventory.recall(there, min(since_ns, heartbeat_ns))
        self._heed({of: at_ns for of, at_ns in forgotten.items() if at_ns >= there.get((of, ""), 0)})
        self._poses.restore(poses)
        self._ledger.adopt(kept.intervals)

    async def run(self) -> None:
        """Keep the history until cancelled; what is pending then is written."""
        if self._settings.history == NONE:
            return
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._watch())
                while True:
                    wait_s = await _whole(self._attempt())
                    await asyncio.sleep(wait_s)
        finally:
            await self._end()

    async def _watch(self) -> None:
        """Note who comes and goes and what models disagree about, whether the database can be had or not."""
        while True:
            now_ns = time.time_ns()
            async for _ in in_turns(chain(self._attendance.note(now_ns), self._disagreements.note(now_ns))):
                pass
            await asyncio.sleep(NOTE_S)

    async def _attempt(self) -> float:
        """Write what there is to write; return after how many seconds to do so again."""
        try:
            if self._store is None:
                # one that was there is waited for: whoever moved it may bring it back, and a new one has no users
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
            self._ledger.forget_pending(time.time_ns() - FOLLOWED_NS)
            await self._hand_over(store)

    async def _hand_over(self, store: Store) -> None:
        """Write what people did while this monitor alone thought that it led, and that the alerts are over it raised.

        Whoever leads raises what still holds, and knows nothing of these. What became of theirs is theirs to say.
        """
        forgotten, self._forgotten = self._forgotten, {}
        for robot in filter(self._inventory.is_forgotten, forgotten):
            self.forget(robot)  # with a time that is news to others
        await self._write_forgotten(store)
        changed, acts = dict(self._alerts), set(self._new_acts)
        if changed or acts:
            theirs = await store.known_alerts(changed)
            await store.write([], [over(alert) for name, alert in changed.items() if name not in theirs], None, acts)
            self._written([], changed, acts)

    def _heed(self, forgotten: Mapping[str, int]) -> None:
        """Forget the robots that were forgotten at another monitor, or at this one before."""
        self._heeded_ns = max([self._heeded_ns, *forgotten.values()])
        for robot in forgotten.keys() - self._inventory.robots():
            self._inventory.forget(robot)

    async def _go_on(self, store: Store) -> None:
        """Go on where whoever wrote before stopped."""
        gap_ns, heartbeat_ns = self._inventory.limits.lost_ns, await store.heartbeat_ns()
        kept: Kept = await store.load(heartbeat_ns - gap_ns)
        now_ns, ended = time.time_ns(), [each for each in kept.intervals if not each.open]
        self._ledger.merge([*kept.going_on, *ended], heartbeat_ns, gap_ns, followed=not self._leads)
        self._speaking = self._new_speaking()
        if not self._loaded and now_ns - heartbeat_ns <= gap_ns:
            self._attendance.resume((each for each in kept.going_on if isinstance(each, Presence)), now_ns)
        self.acts.take(kept.acts)
        if not (self._leads and self._loaded):
            self._lead(kept.alerts, kept.acts)
        self._writes = self._loaded = True

    def _lead(self, alerts: Sequence[Alert], acts: Sequence[Act]) -> None:
        if not self._leads:
            self._attendance.lead(time.time_ns())
        self._leads = True
        self._on_lead(alerts, acts)

    async def _flush(self, store: Store) -> None:
        if not self._writes:
            return
        now_ns = time.time_ns()
        self._note_silence(now_ns)
        for _ in range(len(self._ledger) // BATCH):
            some = self._ledger.pending(BATCH)
            await store.write(some)
            self._ledger.written(some)
        some, changed, acts = self._ledger.pending(BATCH), dict(self._alerts), set(self._new_acts)
        await store.write(some, changed.values(), now_ns, acts)
        self._written(some, changed, acts)
        await self._write_forgotten(store)
        before_ns = now_ns - round(self._settings.history_days * DAY_NS)
        if time.monotonic() >= self._due_s and await store.prune(before_ns):
            self._due_s = time.monotonic() + PRUNE_S
        if time.monotonic() >= self._poses_due_s:
            await self._write_poses(store)

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

    def _written(self, some: Iterable[Lasting], changed: dict[str, Alert], acts: AbstractSet[Act]) -> None:
        self._ledger.written(some)
        for name, alert in changed.items():
            if self._alerts.get(name) is alert:
                del self._alerts[name]
        self._new_acts = deque((act for act in self._new_acts if act not in acts), maxlen=MAX_ALERTS)

    def _speaks(self, camera: CameraView, now_ns: int) -> bool:
        return camera.last_ns >= now_ns - self._inventory.limits.stale_ns

    def _new_speaking(self) -> Speaking:
        """Return what finds silent cameras, for a database that has all as going on."""
        return Speaking(self._inventory, self._speaks, speaks=True)

    def _note_silence(self, now_ns: int) -> None:
        """End in the database what cameras had in view that went silent, and resume it when they speak again."""
        for camera in self._speaking.advance(now_ns):
            if camera.lost:
                continue
            in_view = [sighting for sighting in camera.sightings() if sighting.count]
            if self._speaks(camera, now_ns):
                self._sightings.resume(in_view)
            else:
                self._sightings.pause(in_view)

    async def _fail(self, error: HistoryError) -> None:
        if str(error) != self._problem:
            log.warning("history is not kept: %s", error)
        if not self._asked:
            self._asked = True
            self._lead((), ())
        self._problem, self._writes = str(error), False
        await self._close()

    async def _close(self) -> None:
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


def over(alert: Alert) -> Alert:
    """Return an alert as it is once it is resolved."""
    if alert.state is AlertState.RESOLVED:
        return alert
    return replace(alert, state=AlertState.RESOLVED, changed_ns=max(time.time_ns(), alert.changed_ns + 1))


async def _whole(work: Coroutine[None, None, float]) -> float:
    """Await work to its end, however often cancelled: a statement that is broken off may leave its database locked."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is not None:
        raise cancelled from task.exception()
    return task.result()
