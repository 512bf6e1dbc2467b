"""Applies rules to the fleet as it changes; of several monitors one raises alerts."""

import asyncio
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from itertools import islice
from typing import Final
from uuid import uuid4

from bus import Bus
from schemas.alerts import Alert, AlertState
from schemas.keys import CameraKey
from services.monitor.alerting.delivery import Delivery
from services.monitor.alerting.webhooks import Outcome
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.history.state import Act
from services.monitor.inventory.availability import AbsenceTracker, AvailabilityTracker
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import Inventory
from services.monitor.inventory.member_limit import MAX_MEMBERS
from services.monitor.inventory.sighting import NS, Change
from services.monitor.liveness import SETTLE_NS, Heartbeat
from services.monitor.rules.engine import MAX_SUBJECTS, RuleEngine
from services.monitor.rules.findings import CameraState
from services.monitor.rules.missed_conditions import MissedConditions
from services.monitor.rules.model import WorldRule
from services.monitor.rules.rule_file import RuleFile
from services.monitor.rules.subjects import Effect, UnknownAlertError, linked
from services.monitor.world.conditions import WorldConditions

TICK_S: Final = 0.1
SWEEP_S: Final = 0.2
"""Period of the sweep over cameras, in seconds."""

WORLD_S: Final = 1.0
"""Period, in seconds, of the evaluation of rules on the objects of sites."""

LATE_NS: Final = NS
"""Age, in nanoseconds, from which on a change came too late for a look at what it tells."""

MAX_WAITING: Final = 10_000
"""Maximum number of changes kept while another monitor raises alerts, or it is open which one does."""

OFFER_S: Final = 10.0
"""Period, in seconds, of the check for room for subjects left out because there were too many."""


class Alerting:
    """Raises alerts by rules, delivers them, and applies operators' actions to them.

    robot_ns: returns the reading of a robot's clock at a time of ours, 0 if it is unknown.
    page: where browsers find the monitor's pages, for links in alerts; empty if that is not known.
    """

    def __init__(
        self,
        rules: RuleFile,
        inventory: Inventory,
        heartbeat: Heartbeat,
        *,
        robot_ns: Callable[[str, int], int] = lambda _robot, _ours_ns: 0,
        settle_s: float = SETTLE_NS / NS,
        offer_s: float = OFFER_S,
        conditions: WorldConditions | None = None,
        page: str = "",
        most_subjects: int = MAX_SUBJECTS,
    ) -> None:
        self._rules = rules
        self._inventory = inventory
        self._heartbeat = heartbeat
        self._settled_s = time.monotonic() + settle_s
        self._offer_s = offer_s
        self._offered_s = time.monotonic()
        self._most_subjects = most_subjects
        self._conditions = conditions
        self._page = page
        self._engine: RuleEngine | None = None
        self._since_ns = self._taken_ns = 0
        self._waiting = deque[Change](maxlen=MAX_WAITING)
        self._missed = MissedConditions(_new_id, page=page)
        self._effects: list[Effect] = []
        self._robots: set[str] = set()
        self._news = inventory.follow()
        self._availability = AvailabilityTracker(inventory, inventory.is_available, available=False)
        self._absentees = AbsenceTracker(inventory, self._heartbeat)
        self._look_at_all = True
        self._unsteady: set[CameraKey] = set()
        self._delivery = Delivery(robot_ns)
        inventory.on_leave(self._leave)
        inventory.member_limit.held = self._held

    def _held(self) -> set[tuple[str, str]]:
        """Return the robots, and cameras, with open alerts."""
        return {(alert.robot, alert.camera) for alert in self.alerts()}

    def _leave(self, left: Collection[CameraView]) -> None:
        """Forget cameras that made room for others."""
        self._unsteady.difference_update(view.key for view in left)
        gone = {(view.key.robot, view.key.camera) for view in left}
        self._missed.forget(gone)
        if self._engine is not None:
            self._engine.forget(gone)

    def lead(self, alerts: Sequence[Alert], acts: Iterable[Act] = (), since_ns: int = 0) -> None:
        """Begin to raise alerts, continuing those that another monitor, or an earlier run, left unresolved.

        acts: what people did with these. since_ns: until when, epoch, the other one raised alerts: this one does of
        what changed later, also where that is over.
        """
        if self._engine is None:
            self._engine = RuleEngine(self._rules.book, _new_id, most=self._most_subjects, page=self._page)
        escalated = {act.alert_id for act in acts if act.state is AlertState.ESCALATED}
        self._engine.restore(alerts, time.time_ns(), escalated)
        self._begin_anew()
        if self._conditions is not None:
            self._conditions.adopt(self._engine.alerts())
        self._since_ns = since_ns
        waiting = list(self._waiting)
        self._waiting.clear()
        self._take(self._engine, waiting, late_ns=0)

    def owe(self, alerts: Iterable[tuple[str, Alert]]) -> None:
        """Queue alerts that webhooks, by name, did not accept before a restart."""
        waiting: dict[str, list[Alert]] = {}
        for name, alert in alerts:
            waiting.setdefault(name, []).append(linked(alert, self._page))
        webhooks = self._rules.book.webhooks
        for name in waiting.keys() & webhooks.keys():
            self._delivery.webhooks.owe(name, webhooks[name], waiting[name])

    def owed(self) -> Iterator[tuple[str, Alert]]:
        """Yield the alerts that webhooks, by name, have not accepted yet, in their current state."""
        return self._delivery.webhooks.owed()

    def owed_changes(self) -> int:
        """Return how often these have changed."""
        return self._delivery.webhooks.changes()

    def take(self, changes: Iterable[Change]) -> None:
        """Take changes of the inventory."""
        if self._engine is None:
            self._waiting.extend(changes)
        else:
            self._take(self._engine, changes, late_ns=LATE_NS)

    def _take(self, engine: RuleEngine, changes: Iterable[Change], late_ns: int) -> None:
        """Take changes. late_ns: the age from which on one came too late for a look."""
        now_ns, before_ns = time.time_ns(), self._taken_ns
        self._taken_ns = now_ns
        if now_ns < before_ns:  # the clock was set back
            self._since_ns = 0
            self._missed.clear()
        for change in changes:
            camera = self._inventory.camera(change.sighting.key)
            if camera is None:
                continue
            known_ns = self._known_ns(change)
            late = now_ns - known_ns >= late_ns
            if known_ns > self._since_ns:
                self._effects += self._missed.take(change, engine, now_ns, late=late)
            if late:
                self._look(engine, camera, now_ns)  # until it has caught up, nothing is raised as if it were now
            self._unsteady.add(camera.key)
            if known_ns > self._since_ns or late_ns:
                engine.changed([change], now_ns)

    def _known_ns(self, change: Change) -> int:
        """Return by when a monitor that hears everything in time knows of a change."""
        of = change.sighting
        return of.since_ns + self._inventory.limits.debounce.vanish_ns if of.count == 0 else of.last_ns

    def measured(self, key: CameraKey) -> None:
        """Evaluate the rules for a camera whose distances arrived."""
        camera = self._inventory.camera(key)
        if self._engine is not None and camera is not None:
            self._look(self._engine, camera, time.time_ns())

    def alerts(self) -> list[Alert]:
        """Return the unresolved alerts; empty if another monitor raises them."""
        return [] if self._engine is None else self._engine.alerts()

    def problems(self) -> list[str]:
        """Return lines for failing webhooks of the rules in force, and for a late heartbeat of the monitor."""
        waits = (
            ["silence alerts are held back: the monitor's own heartbeat is late; check the load of this machine"]
            if self._heartbeat.deaf
            else []
        )
        too_many = [] if self._conditions is None else list(self._conditions.problems())
        return [*waits, *too_many, *self._delivery.webhooks.problems(self._rules.book.webhooks)]

    def posts(self) -> Mapping[tuple[str, Outcome], int]:
        """Return the number of webhook alerts by webhook name and outcome."""
        return self._delivery.webhooks.counts

    def acknowledge(self, alert_id: str) -> Alert:
        """Acknowledge an alert; raises UnknownAlertError."""
        return self._known().acknowledge(alert_id, time.time_ns())

    def escalate(self, alert_id: str) -> Alert:
        """Escalate an alert; raises UnknownAlertError."""
        return self._known().escalate(alert_id, time.time_ns())

    def resolve(self, alert_id: str) -> Alert:
        """Resolve an alert; raises UnknownAlertError."""
        return self._known().resolve(alert_id, time.time_ns())

    async def run(self, bus: Bus, *, keep: Callable[[Alert], None], leads: Callable[[], bool]) -> None:
        """Apply the rules and send the resulting alerts and actions, until cancelled.

        keep: takes every alert that changed, for the store. leads: whether this monitor is the one that raises alerts.
        """
        async with asyncio.TaskGroup() as group:
            group.create_task(self._rules.watch())
            group.create_task(self._delivery.run(bus))
            group.create_task(self._apply(keep, leads))

    async def _apply(self, keep: Callable[[Alert], None], leads: Callable[[], bool]) -> None:
        swept_s = world_s = 0.0
        while True:
            await asyncio.sleep(TICK_S)
            turned = self._heartbeat.advance(time.monotonic())
            if turned:
                self._begin_anew()
            if not leads():
                self._delivery.webhooks.clear()
                self._missed.clear()
                self._effects.clear()
                self._engine = None
            engine = self._engine
            if engine is None:
                continue
            if engine.book is not self._rules.book:
                engine.replace(self._rules.book, time.time_ns())
                self._delivery.webhooks.keep(self._rules.book.webhooks)
                self._missed.clear()
                self._look_at_all = True
            if time.monotonic() >= max(self._settled_s, 0 if turned else swept_s + SWEEP_S):
                swept_s = time.monotonic()
                self._offer_again(engine)
                await self._sweep(engine)
            if self._conditions is not None and time.monotonic() >= world_s + WORLD_S:
                world_s = time.monotonic()
                await self._look_at_sites(engine, self._conditions)
            missed, self._effects = self._effects, []
            for effect in [*missed, *engine.due(time.time_ns())]:
                keep(effect.alert)
                self._delivery.send(effect, engine.book)

    @staticmethod
    async def _look_at_sites(engine: RuleEngine, conditions: WorldConditions) -> None:
        rules = [rule for rule in engine.book.rules if isinstance(rule, WorldRule)]
        now_ns = time.time_ns()
        async for rule, robot, found in in_turns(conditions.evaluate(rules, now_ns)):
            engine.world(rule, robot, found, time.time_ns())

    def _begin_anew(self) -> None:
        """Re-evaluate everything, as if nothing had been absent before."""
        self._absentees.clear()
        self._look_at_all = True
        if self._conditions is not None:
            self._conditions.begin()

    def _offer_again(self, engine: RuleEngine) -> None:
        """Re-evaluate everything if there is room again for subjects that were left out."""
        if time.monotonic() >= self._offered_s + self._offer_s:
            self._offered_s = time.monotonic()
            self._look_at_all = self._look_at_all or engine.has_room_again()

    async def _sweep(self, engine: RuleEngine) -> None:
        """Check every camera that changed, came, went, resumed or fell silent; all of them if they are due."""
        everything, self._look_at_all = self._look_at_all, False
        robots, cameras = self._take_news()
        turned = set(self._availability.advance(time.time_ns(), self._views(cameras)))
        looked_at = turned.union(self._views(self._unsteady | self._inventory.disputed() | cameras))
        if everything:
            robots, looked_at = self._robots, set(self._inventory.cameras())
        async for camera in in_turns(looked_at):
            self._absentees.look_at_camera(
                camera, time.time_ns(), time.monotonic(), told=camera.key in cameras, ceased=camera in turned
            )
            self._look(engine, camera, time.time_ns())
        gone, silent = self._absentees.ripen(time.time_ns(), time.monotonic())
        async for camera in in_turns(silent):
            self._look(engine, camera, time.time_ns())
        async for robot in in_turns([*robots, *gone]):
            alive, at_ns = self._absentees.look_at_robot(robot, time.time_ns(), time.monotonic())
            engine.robot(robot, alive=alive, now_ns=at_ns)

    def _take_news(self) -> tuple[AbstractSet[str], AbstractSet[CameraKey]]:
        """Return the robots and the cameras that are new, came or went."""
        robots, cameras = self._news.robots, self._news.cameras
        self._news.robots, self._news.cameras = set(), set()
        if len(self._robots | robots) > MAX_MEMBERS:
            held = {robot for robot, _ in self._held()}
            self._robots = {robot for robot in self._robots if robot in held or self._inventory.is_alive(robot)}
            self._absentees.keep_robots(self._robots | robots)
        self._robots.update(islice(robots - self._robots, max(0, MAX_MEMBERS - len(self._robots))))
        return robots & self._robots, cameras

    def _views(self, keys: Iterable[CameraKey]) -> Iterator[CameraView]:
        return (camera for key in keys if (camera := self._inventory.camera(key)) is not None)

    def _look(self, engine: RuleEngine, camera: CameraView, now_ns: int) -> None:
        self._unsteady.discard(camera.key)
        if engine.concerns(camera.key):
            look = self._look_of(camera, now_ns)
            engine.look(look, now_ns)
            if look.nearest or (look.available and not look.settled):  # may become old, or settle, without a change
                self._unsteady.add(camera.key)

    def _look_of(self, camera: CameraView, now_ns: int) -> CameraState:
        unknown = self._heartbeat.deaf or self._inventory.is_forgotten(camera.key.robot)
        if unknown and not self._inventory.is_available(camera, now_ns):
            return CameraState(camera.key, available=False)
        silent_ns = self._absentees.silent_ns(camera.key)
        return look_at(self._inventory, camera, now_ns, silent_ns, complete=self._heartbeat.settled)

    def _known(self) -> RuleEngine:
        if self._engine is None:
            raise UnknownAlertError("another monitor raises the alerts")
        return self._engine


def _new_id() -> str:
    return uuid4().hex


def look_at(
    inventory: Inventory, camera: CameraView, now_ns: int, silent_ns: int | None = None, *, complete: bool = True
) -> CameraState:
    """Return the current state of a camera. silent_ns, complete: see `CameraState`."""
    since_ns = now_ns - inventory.limits.stale_ns
    sighted = list(camera.sighted())
    return CameraState(
        key=camera.key,
        available=inventory.is_available(camera, now_ns),
        silent_ns=silent_ns,
        complete=complete,
        counts={name: tracked.count.count for name, tracked in sighted},
        settled=camera.settled,
        nearest={name: near for name, tracked in sighted if (near := tracked.nearest_since(since_ns)) is not None},
        disagreements=camera.disagreements(since_ns),
    )
