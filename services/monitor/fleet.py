"""The state of the fleet, driven by messages, presence and time. Pure."""

from collections import Counter, deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Final

import msgspec

from schemas.detections import ClassCount, ClassList
from schemas.distances import Distances
from schemas.header import Header
from schemas.keys import CameraKey, camera_key
from schemas.status import GatewayStatus, WorkerStatus
from services.monitor.duplicate_gateways import DUPLICATE_GATEWAY, DuplicateGateways, RivalSenders
from services.monitor.formats import cameras_in_order, natural_camera
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.inventory.member_limit import MAX_MEMBERS, check_room, first_leaving
from services.monitor.inventory.sighting import NS, Change
from services.monitor.liveness import STALE_S, WORKER_ONLINE_NS, CameraLiveness, camera_state, is_stale
from services.monitor.map.last_seen import SightingMap
from services.monitor.robot_clocks import MAX_LAG_NS, Clocks
from services.monitor.status_bytes import StatusBytes
from services.monitor.warehouses.reports import Warehouses
from services.monitor.world.site_objects import World
from services.monitor.world.site_status import Sites

RATE_WINDOW_S: Final = 5.0
MAX_AGES: Final = 100_000
MOST_ARRIVALS: Final = 64
DAY_NS: Final = 86_400 * NS
LATE_NS: Final = 2 * NS
LATE_FOR_NS: Final = 10 * NS
"""No mere outage held up lists that keep coming for so long and were longer than LATE_NS on their way: lists that an
outage held up come at once. It is over when none came for as long."""


SLOW_LINK: Final = "has class lists that arrive more than 2 s late; on a slow link, set --uplink-mbit"


class Age(msgspec.Struct, frozen=True, gc=False):
    """The age of a view; only a lower bound, without transport delay, while the robot's clock offset is unknown."""

    seconds: float
    exact: bool


class Row(msgspec.Struct, frozen=True, gc=False):
    """One camera as shown to an operator. Fields are None before the first class list.

    classes: what is in view, or was last, as the inventory has settled it, by name. stale_s: how old what it shows may
    be.
    """

    key: CameraKey
    online: bool
    classes: tuple[ClassCount, ...] | None
    age: Age | None
    rate_hz: float
    stale_s: float = STALE_S

    @property
    def age_s(self) -> float | None:
        """The age of the view in seconds; None before the first class list."""
        return None if self.age is None else self.age.seconds

    @property
    def stale(self) -> bool:
        """Whether the row may be outdated."""
        return is_stale(self.age_s, self.stale_s, online=self.online)

    @property
    def state(self) -> CameraLiveness:
        """The state of the camera."""
        return camera_state(self.age_s, self.stale_s, online=self.online)


@dataclass(slots=True)
class _Camera:
    arrived_s: float = 0.0
    lag_s: float | None = None
    lists: int = 0
    arrivals: list[float] = field(default_factory=list)  # a deque takes 700 bytes more, of thousands of cameras

    def rate_hz(self, now_s: float) -> float:
        recent = self.arrivals
        while recent and now_s - recent[0] > RATE_WINDOW_S:
            del recent[0]
        return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0


UNHEARD: Final = _Camera()


class Fleet:
    """All robots and cameras ever seen, their views and their health.

    clock_id: the clock of this machine; a robot's ages are exact when it reads the same one, or when `clocks` knows how
    far it is off. Every method that may add a member raises InventoryFullError when there are too many already.
    heard_ns, worker_heard_ns: when the newest status of a gateway, or worker, arrived.
    """

    def __init__(self, clock_id: str, limits: TrustLimits | None = None) -> None:
        self._clock_id = clock_id
        self.clocks = Clocks()
        self.inventory = Inventory(limits)
        self.places = SightingMap()
        self.sites = Sites()
        self.world = World()
        self.warehouses = Warehouses()
        self._cameras: dict[CameraKey, _Camera] = {}
        self.gateways: dict[str, GatewayStatus] = {}
        self.workers: dict[tuple[str, str], WorkerStatus] = {}
        self.heard_ns: dict[str, int] = {}
        self.worker_heard_ns: dict[tuple[str, str], int] = {}
        self.ages_s: deque[float] = deque(maxlen=MAX_AGES)
        self.first_list_s: float | None = None
        self.class_lists = 0
        self.refused_lists = 0
        self.left_out: Counter[str] = Counter()
        self._changed: set[CameraKey] = set()
        self.duplicates = DuplicateGateways()
        self.rivals = RivalSenders()
        self._late: dict[str, dict[CameraKey, tuple[int, int]]] = {}
        self._gateway_bytes, self._worker_bytes = StatusBytes[str](), StatusBytes[tuple[str, str]]()
        self.inventory.on_leave(self._leave)

    def _leave(self, left: Collection[CameraView]) -> None:
        """Forget cameras that made room for others, and poses of robots without any other."""
        for view in left:
            self._cameras.pop(view.key, None)
            self._changed.discard(view.key)
            self.rivals.forget(view.key)
            self._note_in_time(view.key)
            if not self.inventory.member_limit.of(view.key.robot) and not self.inventory.is_alive(view.key.robot):
                self.places.forget(view.key.robot)

    def robot_presence(self, robot: str, *, alive: bool) -> None:
        """Note that a robot's gateway came or went."""
        self.inventory.robot_presence(robot, alive=alive)
        self._changed.update(self.inventory.in_order(robot))

    def camera_presence(self, key: CameraKey, *, alive: bool) -> None:
        """Note that a camera came or went. One that went stays on the list."""
        self.inventory.camera_presence(key, alive=alive)
        self._camera(key)
        self._note_in_time(key)
        self._changed.add(key)

    def gateway_status(self, status: GatewayStatus, received_ns: int, size: int = 0) -> None:
        """Keep the newest status of a gateway, received at `received_ns` (epoch). size: its bytes (`StatusBytes`)."""
        if status.robot not in self.gateways and len(self.gateways) >= MAX_MEMBERS:
            held = {robot for robot, _ in self.inventory.member_limit.held()} | self.inventory.robots()
            for robot in first_leaving(self.heard_ns, held.__contains__):
                self._forget_gateway(robot)
        for robot in self._gateway_bytes.take(status.robot, size):
            self._forget_gateway(robot)
        self.heard_ns.pop(status.robot, None)  # keeps the order: the longest silent first
        self.gateways[status.robot], self.heard_ns[status.robot] = status, received_ns
        self.duplicates.take(status.robot, status.boot_id)

    def _forget_gateway(self, robot: str) -> None:
        del self.gateways[robot], self.heard_ns[robot]
        self._gateway_bytes.drop(robot)
        self._late.pop(robot, None)
        self.duplicates.forget(robot)

    def worker_status(self, status: WorkerStatus, received_ns: int, size: int = 0) -> None:
        """Keep the newest status of a worker, received at `received_ns` (epoch); see `gateway_status`."""
        name = (status.service, status.worker)
        if name not in self.workers:
            self._forget_workers(received_ns)
        check_room(self.workers, name)
        for each in self._worker_bytes.take(name, size):
            self._forget_worker(each)
        self.worker_heard_ns.pop(name, None)  # keeps the order: the longest silent first
        self.workers[name], self.worker_heard_ns[name] = status, received_ns
        self.inventory.worker_reports(*name, status.classes)

    def _forget_workers(self, now_ns: int) -> None:
        """Forget those silent for a day, or offline where there is no room: each process has a name of its own."""
        silent_ns = WORKER_ONLINE_NS if len(self.workers) >= MAX_MEMBERS else DAY_NS
        while self.worker_heard_ns:
            name, heard_ns = next(iter(self.worker_heard_ns.items()))
            if now_ns - heard_ns <= silent_ns:
                return
            self._forget_worker(name)

    def _forget_worker(self, name: tuple[str, str]) -> None:
        del self.workers[name], self.worker_heard_ns[name]
        self._worker_bytes.drop(name)
        self.inventory.forget_worker(*name)

    def see(self, seen: ClassList, now_s: float, received_ns: int) -> list[Change] | None:
        """Take a class list that arrived at `received_ns` (epoch) and `now_s` (any steady clock).

        Returns:
            The changes of the inventory; None for a list about a frame that is not newer than the camera's last one.
        """
        key = camera_key(seen.header.robot, seen.header.camera)
        lag_ns = self._lag_ns(seen.header, received_ns)
        changes = self.inventory.see(seen, received_ns - (lag_ns or 0))
        self.rivals.take(key, seen, received_ns)
        if changes is None:
            self.refused_lists += 1
            return None
        self.class_lists += 1
        camera = self._camera(key)
        if self.first_list_s is None:
            self.first_list_s = now_s
        if changes:
            self._changed.add(key)
        camera.arrived_s = now_s
        camera.lists += 1
        camera.arrivals.append(now_s)
        del camera.arrivals[:-MOST_ARRIVALS]
        camera.lag_s = None if lag_ns is None else lag_ns / 1e9
        if camera.lag_s is not None:
            self.ages_s.append(camera.lag_s)
        if (lag_ns or 0) > LATE_NS and (lag_ns or 0) - sum(seen.spans.values()) > LATE_NS:
            self._note_late(key, received_ns)
        else:
            self._note_in_time(key)
        return changes

    def _note_late(self, key: CameraKey, at_ns: int) -> None:
        """Note that a list came late, and when the first did of those that came one after the other."""
        late = self._late.setdefault(key.robot, {})
        first_ns, newest_ns = late.get(key, (at_ns, at_ns))
        late[key] = (first_ns if at_ns - newest_ns <= LATE_FOR_NS else at_ns, at_ns)

    def _note_in_time(self, key: CameraKey) -> None:
        if key.robot in self._late:
            self._late[key.robot].pop(key, None)

    def opine(self, seen: ClassList, received_ns: int) -> bool:
        """Take a second opinion received at `received_ns`; return False if it is ignored, see `Inventory`."""
        return self.inventory.opine(seen, received_ns - (self._lag_ns(seen.header, received_ns) or 0))

    def measure(self, distances: Distances, received_ns: int) -> bool:
        """Take distances received at `received_ns`; return False for a duplicate."""
        at_ns = received_ns - (self._lag_ns(distances.header, received_ns) or 0)
        if not self.inventory.measure(distances, at_ns):
            return False
        self.places.take(distances, at_ns)
        return True

    def tick(self, now_ns: int) -> list[Change]:
        """Advance time; return the sightings that became unknown."""
        self.places.tick(now_ns)
        return self.inventory.tick(now_ns)

    def age_of(self, header: Header, arrived_ns: int, now_ns: int) -> Age:
        """Return the age at `now_ns` of a frame, of which a message arrived at `arrived_ns`."""
        theirs_ns = self._theirs_ns(header.robot, now_ns)
        age_ns = now_ns - arrived_ns if theirs_ns is None else theirs_ns - header.received_ns
        return Age(max(0, age_ns) / 1e9, exact=theirs_ns is not None)

    def problems_of(self, robot: str) -> Iterator[str]:
        """Yield the known problems of a robot's gateway."""
        if self.duplicates.has(robot):
            yield DUPLICATE_GATEWAY
        if (status := self.gateways.get(robot)) is not None:
            yield from problems_of(status)
        since_ns = self.heard_ns.get(robot, 0) - LATE_FOR_NS
        late = self._late.get(robot, {}).values()
        if any(newest_ns >= since_ns and newest_ns - first_ns >= LATE_FOR_NS for first_ns, newest_ns in late):
            yield SLOW_LINK

    def online(self) -> Iterator[GatewayStatus]:
        """Yield the newest status of every gateway online."""
        yield from (self.gateways[robot] for robot in self.inventory.robots() & self.gateways.keys())

    def elsewhere(self) -> Iterator[str]:
        """Yield the online robots whose clock is not this machine's."""
        yield from (status.robot for status in self.online() if status.clock_id != self._clock_id)

    @property
    def cameras(self) -> int:
        """The number of cameras ever seen, without those of forgotten robots."""
        return len(self.inventory.in_order())

    def rows(self, now_s: float) -> Iterator[Row]:
        """Yield every camera, by robot and name; also those known only from before a restart."""
        return (self.row(key, now_s) for key in cameras_in_order(self.inventory.in_order()))

    def take_changed(self, now_s: float) -> Iterator[Row]:
        """Yield the cameras, by robot and name, that came, went or changed counts since the last call."""
        changed, self._changed = self._changed, set()
        return (self.row(key, now_s) for key in sorted(changed, key=natural_camera))

    def row(self, key: CameraKey, now_s: float) -> Row:
        """Return one camera."""
        camera, view = self._cameras.get(key, UNHEARD), self.inventory.camera(key)
        return Row(
            key=key,
            online=self.inventory.online(key),
            classes=None if view is None else view.in_view(),
            age=_age(camera, now_s),
            rate_hz=camera.rate_hz(now_s),
            stale_s=self.inventory.limits.stale_ns / NS,
        )

    def lists_per_robot(self) -> Counter[str]:
        """Count the class lists received from each known robot."""
        counts = Counter(dict.fromkeys(self.inventory.robots(), 0))
        for key, camera in self._cameras.items():
            counts[key.robot] += camera.lists
        return counts

    def _camera(self, key: CameraKey) -> _Camera:
        camera = self._cameras.get(key)
        if camera is None:
            camera = self._cameras[key] = _Camera()
        return camera

    def is_dated(self, header: Header, received_ns: int) -> bool:
        """Whether the age of a frame was known when its message arrived."""
        return self._theirs_ns(header.robot, received_ns) is not None

    def _lag_ns(self, header: Header, received_ns: int) -> int | None:
        """Return how old a frame was when something of it arrived, or None if its robot's clock says nothing of it."""
        theirs_ns = self._theirs_ns(header.robot, received_ns)
        lag_ns = None if theirs_ns is None else max(0, theirs_ns - header.received_ns)
        return None if lag_ns is None or lag_ns > MAX_LAG_NS else lag_ns

    def _theirs_ns(self, robot: str, ours_ns: int) -> int | None:
        """Return the reading of the robot's clock when ours shows `ours_ns`; None if its offset is unknown."""
        status = self.gateways.get(robot)
        if status is None:
            return None
        if status.clock_id == self._clock_id:
            return ours_ns
        return self.clocks.theirs_ns(robot, status.clock_id, ours_ns)


def _age(camera: _Camera, now_s: float) -> Age | None:
    if not camera.lists:
        return None
    return Age(now_s - camera.arrived_s + (camera.lag_s or 0.0), exact=camera.lag_s is not None)


def problems_of(gateway: GatewayStatus) -> Iterator[str]:
    """Yield the missing dependency and the stream problems of a gateway, in its own words."""
    if gateway.waiting_for:
        yield f"waits for {gateway.waiting_for}"
    for stream in gateway.streams:
        if stream.problem:
            yield f"{stream.name}: {stream.problem}"
