"""The monitor as its page and API see it: the data they read and the actions they offer."""

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Final

from bus import Bus
from bus.session.access import open_endpoints
from schemas.alerts import Alert, AlertState
from schemas.worker_keys import DETECTOR, OPINION
from services.model_registry.serving import ModelService
from services.monitor.alerting.alerting import Alerting
from services.monitor.duplicate_gateways import DUPLICATE_GATEWAY
from services.monitor.event_loop.cached_value import CachedValue
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.fleet import Fleet
from services.monitor.health import Health
from services.monitor.history.archive import Archive, HistoryQuery
from services.monitor.history.state import Act
from services.monitor.history.writer import HistoryWriter
from services.monitor.inventory.inventory import Entry
from services.monitor.map.floor_plan import FloorPlan
from services.monitor.rules.loading import remarks
from services.monitor.rules.model import RuleBook, WorldRule
from services.monitor.rules.rule_file import RuleFile
from services.monitor.settings import MonitorSettings
from services.monitor.snapshot import FleetView, Snapshot, SnapshotMaker, Workers, known_until_ns
from services.monitor.warehouses.centre_link import CentreLink
from services.monitor.world.conditions import remarks_on_zones
from services.monitor.world.site_objects import World
from services.monitor.world.zone_file import ZoneFile

log = logging.getLogger(__name__)

MAX_AGE_S: Final = 0.5
"""Maximum age of a shared snapshot, in seconds; it limits the load of many viewers."""

REMARKS_AGE_S: Final = 10.0
"""Maximum age of remarks about rules, in seconds: each unmatched pattern is compared with all robots."""

MAX_READ_AGE_S: Final = 2.0
"""Maximum age, in seconds, of data read from another monitor's history."""

OPEN: Final = (
    "links are open (--insecure): whoever reaches this machine's Zenoh port may read everything and send as any robot;"
    " `fleetsight pki` and `fleetsight access` close them"
)

MAX_ALERTS: Final = 10_000
MAX_RIVALS: Final = 3
MAX_REMARKS: Final = 20
"""Maximum number of remarks about rules."""

NOT_RESOLVED: Final = tuple(state for state in AlertState if state is not AlertState.RESOLVED)


class UnknownRobotError(Exception):
    """The robot is unknown or was forgotten."""


class RobotThereError(Exception):
    """A robot cannot be forgotten while its gateway is there."""


@dataclass(slots=True, eq=False)
class Monitor:
    """Everything in a running monitor.

    floor_plan: the map's background. zones: the file of them. started_ns: its start, epoch. centre: its link to the
    monitor above it, if it has one. models: the registry of published models, if it keeps one.

    Views of the whole fleet (`snapshot`, `inventory`) are made at most every MAX_AGE_S for all callers.
    """

    settings: MonitorSettings
    bus: Bus
    fleet: Fleet
    rules: RuleFile
    alerting: Alerting
    history: HistoryWriter
    archive: Archive
    health: Health
    floor_plan: FloorPlan | None = None
    zones: ZoneFile = field(default_factory=lambda: ZoneFile(None, World(on=False)))
    centre: CentreLink = field(default_factory=CentreLink)
    models: ModelService | None = None
    started_ns: int = field(default_factory=time.time_ns)
    _workers: tuple[float, Workers] | None = field(default=None, init=False, repr=False)
    _remarks: tuple[float, RuleBook, list[str]] | None = field(default=None, init=False, repr=False)
    _snapshot: CachedValue[Snapshot] = field(init=False, repr=False)
    _inventory: CachedValue[tuple[Entry, ...]] = field(init=False, repr=False)
    _others: CachedValue[Sequence[Alert]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._snapshot = CachedValue(self._make_snapshot, MAX_AGE_S)
        self._inventory = CachedValue(self._list, MAX_AGE_S)
        self._others = CachedValue(self._read_alerts, MAX_READ_AGE_S)

    def fleet_view(self) -> FleetView:
        """Return the current fleet, from which parts are made on demand."""
        return FleetView(self.fleet, self.workers(), time.time_ns(), time.monotonic())

    def workers(self) -> Workers:
        """Return the workers as of at most MAX_AGE_S ago."""
        now_s = time.monotonic()
        if self._workers is None or now_s - self._workers[0] > MAX_AGE_S:
            self._workers = now_s, Workers(self.fleet, time.time_ns())
        return self._workers[1]

    async def snapshot(self) -> Snapshot:
        """Return all robots, cameras and workers; for thousands this takes tenths of a second."""
        return await self._snapshot.get()

    async def inventory(self) -> tuple[Entry, ...]:
        """Return the sightings of every camera, by robot, camera and class."""
        return await self._inventory.get()

    def alerts(self) -> list[Alert]:
        """Return the unresolved alerts; empty if another monitor raises them."""
        return self.alerting.alerts()

    async def current_alerts(self) -> Sequence[Alert]:
        """Return the unresolved alerts; if another monitor raises them, from the history.

        Raises:
            HistoryError: they cannot be read.
        """
        return self.alerts() if self.history.status.leads else await self._others.get()

    def acts_of(self, alert_id: str) -> tuple[Act, ...]:
        """Return operators' actions on an unresolved alert, in order."""
        return self.history.acts.of(alert_id)

    def known_until_ns(self, alert: Alert) -> int | None:
        """Return when an alert's condition was last confirmed; None if it is current."""
        return known_until_ns(alert, self.fleet.inventory, time.time_ns())

    def acknowledge(self, alert_id: str, by: str) -> Alert:
        """Acknowledge an alert; raises UnknownAlertError. by: a user's name."""
        return self._noted(self.alerting.acknowledge(alert_id), by)

    def escalate(self, alert_id: str, by: str) -> Alert:
        """Escalate an alert; raises UnknownAlertError. by: a user's name."""
        return self._noted(self.alerting.escalate(alert_id), by)

    def resolve(self, alert_id: str, by: str) -> Alert:
        """Resolve an alert; raises UnknownAlertError. by: a user's name."""
        return self._noted(self.alerting.resolve(alert_id), by)

    def forget(self, robot: str, by: str) -> None:
        """Take an offline robot off every list until its gateway is back, and resolve its alerts.

        by: a user's name.

        Raises:
            UnknownRobotError: it is on none.
            RobotThereError: its gateway is there.
        """
        if robot not in self.fleet_view().robots:
            raise UnknownRobotError(f"no robot {robot[:64]!r}")
        if self.fleet.inventory.is_alive(robot):
            raise RobotThereError(f"the gateway of {robot} is there: stop it first")
        for alert in [alert for alert in self.alerts() if alert.robot == robot]:
            self.resolve(alert.id, by)
        self.fleet.inventory.forget(robot)
        self.history.forget(robot)
        log.info("%s removed robot %s from the fleet", by, robot)

    def trust_clock(self, by: str) -> None:
        """Trust this machine's clock. by: a user's name."""
        self.history.trust_clock()
        log.info("%s confirmed the clock of this machine", by)

    @property
    def open_to_all(self) -> str:
        """A warning if anybody who reaches the router inside this monitor may use it, or empty."""
        return OPEN if open_endpoints(self.settings) else ""

    def problems(self) -> list[str]:
        """Return the monitor's own problems, in lines."""
        status = self.history.status
        not_kept = status.problem and f"history is not being kept: {status.problem}"
        found = (
            not_kept,
            *status.warnings,
            self.rules.problem,
            self.zones.problem,
            self.bus.links.problem,
            *self.bus.links.wrong,
            self.open_to_all,
        )
        own = [problem for problem in (*found, self.centre.problem) if problem]
        own += [] if self.models is None else self.models.problems()
        now_ns = time.time_ns()
        own += [*self.fleet.world.problems(), *self.fleet.sites.problems(now_ns)]
        own += self.fleet.warehouses.problems(now_ns)
        return [*own, *self._rivals(), *self.fleet.inventory.member_limit.problems(), *self.alerting.problems()]

    def _rivals(self) -> Iterator[str]:
        """Yield lines about the first names that several speak under."""
        for robot in self.fleet.duplicates.robots()[:MAX_RIVALS]:
            yield f"{robot} {DUPLICATE_GATEWAY}"
        found = sorted(self.fleet.rivals.found(time.time_ns()).items())
        for key, (one, other) in found[:MAX_RIVALS]:
            yield (
                f"{key}: class lists of {one} and of {other} come by turns: stop one of these workers; if there is only"
                " one of them, somebody sends in its name"
            )

    def rule_remarks(self) -> list[str]:
        """Return remarks about classes and robots in the rules that do not exist, or did not recently."""
        now_s, book = time.monotonic(), self.rules.book
        if self._remarks is None or self._remarks[1] is not book or now_s - self._remarks[0] > REMARKS_AGE_S:
            self._remarks = now_s, book, self._make_remarks(book)
        return self._remarks[2]

    def _make_remarks(self, book: RuleBook) -> list[str]:
        workers, inventory = self.workers(), self.fleet.inventory
        detectors = [each.classes for each in workers.of(DETECTOR)]
        opinions = [each.classes for each in workers.of(OPINION)]

        def seen(name: str) -> bool:
            return any(camera.primary is not None and name in camera.primary.classes for camera in inventory.cameras())

        robots = set(self.fleet_view().robots)
        of_sites = [rule for rule in book.rules if isinstance(rule, WorldRule)]
        every = chain(remarks_on_zones(of_sites, self.fleet.world), remarks(book, detectors, opinions, seen, robots))
        return list(islice(every, MAX_REMARKS))

    def _noted(self, alert: Alert, by: str) -> Alert:
        self.history.act(Act(alert.id, AlertState(alert.state), by, time.time_ns()))
        return alert

    async def _make_snapshot(self) -> Snapshot:
        maker = SnapshotMaker(self.fleet_view())
        async for _ in in_turns(maker.steps()):
            pass
        return maker.snapshot()

    async def _list(self) -> tuple[Entry, ...]:
        return tuple([entry async for entry in in_turns(self.fleet.inventory.entries(time.time_ns()))])

    async def _read_alerts(self) -> Sequence[Alert]:
        found = await self.archive.alerts(HistoryQuery(), MAX_ALERTS, states=NOT_RESOLVED)
        self.history.acts.take(await self.archive.acts([alert.id for alert in found]))
        return found
