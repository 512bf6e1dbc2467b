"""The fleet at one moment for page and API, and whether alerts' conditions are current. Pure."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import msgspec

from schemas.alerts import Alert, AlertState
from schemas.keys import CameraKey
from schemas.status import CameraLoad, GatewayStatus, WorkerStatus
from services.monitor.fleet import Fleet, Row
from services.monitor.inventory.inventory import Inventory, of_robot
from services.monitor.liveness import is_worker_online


class CameraLine(msgspec.Struct, frozen=True, gc=False):
    """One camera. last_ns: when its newest class list came, 0 before the first. dropped: frames, by place and reason.

    served_by: the workers that look after it, as service/worker.
    """

    row: Row
    last_ns: int
    dropped: Mapping[str, int]
    served_by: tuple[str, ...]

    @property
    def key(self) -> CameraKey:
        """Which one."""
        return self.row.key


@dataclass(frozen=True, slots=True)
class RobotLine:
    """One robot. last_ns: its newest message, epoch, our clock; 0 if there was none.

    gateway: its newest account of itself, however old. problems: what is wrong, in words. cameras: names.
    age_s: of the newest class list among its cameras, None before the first. rate_hz: class lists of all of them.
    dropped: frames, by place and reason.
    """

    name: str
    online: bool
    last_ns: int
    gateway: GatewayStatus | None
    problems: tuple[str, ...]
    cameras: tuple[str, ...]
    age_s: float | None
    rate_hz: float
    dropped: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class WorkerLine:
    """One worker. last_ns: arrival of its newest status. online: it reported in the last seconds."""

    status: WorkerStatus
    online: bool
    last_ns: int

    @property
    def name(self) -> str:
        """Its service and its own name."""
        return f"{self.status.service}/{self.status.worker}"

    @property
    def serves(self) -> tuple[CameraLoad, ...]:
        """Frame counts of the cameras that it serves now."""
        return tuple(load for load in self.status.cameras if load.serving) if self.online else ()


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All robots, cameras and workers at `now_ns`, by name."""

    now_ns: int
    robots: tuple[RobotLine, ...]
    cameras: tuple[CameraLine, ...]
    workers: tuple[WorkerLine, ...]


class Workers:
    """The newest status of every worker, by name, and each camera's frame counts there."""

    def __init__(self, fleet: Fleet, now_ns: int) -> None:
        self.lines = tuple(
            WorkerLine(status, is_worker_online(last_ns, now_ns), last_ns)
            for name, status in sorted(fleet.workers.items())
            for last_ns in [fleet.worker_heard_ns.get(name, 0)]
        )
        self._loads = defaultdict[tuple[str, str], list[tuple[WorkerLine, CameraLoad]]](list)
        for line in self.lines:
            for load in line.status.cameras:
                self._loads[load.robot, load.camera].append((line, load))

    def loads(self, key: CameraKey) -> Sequence[tuple[WorkerLine, CameraLoad]]:
        """Return a camera's frame counts at each worker that received any."""
        return self._loads.get((key.robot, key.camera), ())

    def of(self, service: str) -> list[WorkerStatus]:
        """Return the status of a service's online workers."""
        return [line.status for line in self.lines if line.online and line.status.service == service]

    def serving(self, key: CameraKey) -> tuple[str, ...]:
        """Return the workers that serve a camera now, as service/worker."""
        return tuple(line.name for line, load in self.loads(key) if load.serving and line.online)


class FleetView:
    """The fleet at `now_ns` (epoch), `now_s` on a steady clock. Parts made later show later messages.

    robots: all that were ever heard of and not forgotten, by name. cameras: theirs, by robot and name.
    """

    def __init__(self, fleet: Fleet, workers: Workers, now_ns: int, now_s: float) -> None:
        self.fleet, self.workers, self.now_ns = fleet, workers, now_ns
        self._now_s = now_s
        self.cameras = fleet.inventory.in_order()
        self.robots = _robots(fleet, self.cameras)

    def cameras_of(self, robot: str) -> Sequence[CameraKey]:
        """Return a robot's cameras, by name."""
        return of_robot(self.cameras, robot)

    def row(self, key: CameraKey) -> Row:
        """Return a camera as shown to an operator."""
        return self.fleet.row(key, self._now_s)

    def last_ns(self, robot: str, cameras: Iterable[CameraKey]) -> int:
        """Return the time of a robot's newest message; 0 if there was none. cameras: all of the robot's."""
        newest = self.fleet.heard_ns.get(robot) or self.fleet.inventory.recalled().get(robot, 0)
        for key in cameras:
            view = self.fleet.inventory.camera(key)
            if view is not None and view.last_ns > newest:
                newest = view.last_ns
        return newest

    def drops(self, robot: str, cameras: Iterable[CameraKey]) -> int:
        """Return a robot's dropped frames at all places. cameras: all of the robot's."""
        count = sum(sum(load.dropped.values()) for key in cameras for _, load in self.workers.loads(key))
        gateway = self.fleet.gateways.get(robot)
        if gateway is not None:
            count += sum(sum(stream.dropped.values()) for stream in gateway.streams) + sum(gateway.withdrawn.values())
        return count

    def camera(self, key: CameraKey) -> CameraLine:
        """Return the full data of a camera."""
        return self.camera_of(self.row(key))

    def camera_of(self, row: Row) -> CameraLine:
        """Return the full data of a camera whose row exists already."""
        key = row.key
        dropped = _drops_of(self.fleet.gateways.get(key.robot), key.camera)
        for worker, load in self.workers.loads(key):
            _add(dropped, worker.name, load.dropped)
        view = self.fleet.inventory.camera(key)
        return CameraLine(row, 0 if view is None else view.last_ns, dropped, self.workers.serving(key))

    def robot(self, name: str) -> RobotLine:
        """Return the full data of a robot."""
        return self.robot_of(name, [self.camera(key) for key in self.cameras_of(name)])

    def robot_of(self, name: str, cameras: Sequence[CameraLine]) -> RobotLine:
        """Return the full data of a robot whose cameras exist already."""
        gateway = self.fleet.gateways.get(name)
        dropped = _drops_of(gateway, "")
        if gateway is not None:
            _add(dropped, "gateway", gateway.withdrawn)
        for camera in cameras:
            for reason, count in camera.dropped.items():
                dropped[reason] = dropped.get(reason, 0) + count
        ages = [camera.row.age.seconds for camera in cameras if camera.row.age is not None]
        return RobotLine(
            name=name,
            online=self.fleet.inventory.is_alive(name),
            last_ns=self.last_ns(name, [camera.key for camera in cameras]),
            gateway=gateway,
            problems=tuple(self.fleet.problems_of(name)),
            cameras=tuple(camera.key.camera for camera in cameras),
            age_s=min(ages, default=None),
            rate_hz=sum(camera.row.rate_hz for camera in cameras),
            dropped=dropped,
        )


class SnapshotMaker:
    """Makes a snapshot step by step, so that other tasks run in between."""

    def __init__(self, fleet_view: FleetView) -> None:
        self._fleet_view = fleet_view
        self._cameras: list[CameraLine] = []
        self._robots: list[RobotLine] = []

    def steps(self) -> Iterator[None]:
        """Yield after each step."""
        for name in self._fleet_view.robots:
            cameras = [self._fleet_view.camera(key) for key in self._fleet_view.cameras_of(name)]
            self._cameras += cameras
            self._robots.append(self._fleet_view.robot_of(name, cameras))
            yield

    def snapshot(self) -> Snapshot:
        """Return the snapshot, once all steps are done."""
        return Snapshot(
            self._fleet_view.now_ns, tuple(self._robots), tuple(self._cameras), self._fleet_view.workers.lines
        )


def _robots(fleet: Fleet, cameras: Iterable[CameraKey]) -> tuple[str, ...]:
    names = dict.fromkeys([key.robot for key in cameras])
    inventory = fleet.inventory
    bare = (inventory.robots() | inventory.recalled().keys() | fleet.gateways.keys()) - names.keys()
    bare = {name for name in bare if not inventory.is_forgotten(name)}
    return tuple(sorted([*names, *bare])) if bare else tuple(names)


def _drops_of(gateway: GatewayStatus | None, camera: str) -> dict[str, int]:
    """Return a gateway's drops of a camera's streams; of those of the whole robot if the camera is empty."""
    dropped: dict[str, int] = {}
    for stream in () if gateway is None else gateway.streams:
        if stream.camera == camera:
            _add(dropped, "gateway", stream.dropped)
    return dropped


def _add(dropped: dict[str, int], where: str, more: Mapping[str, int]) -> None:
    for reason, count in more.items():
        if count:
            named = f"{where}: {reason}"
            dropped[named] = dropped.get(named, 0) + count


def known_until_ns(alert: Alert, inventory: Inventory, now_ns: int) -> int | None:
    """Return when the condition was last confirmed; None if it is current, resolved, or a silence alert.

    That is when its camera was heard last, or, if that is unknown, when it was raised.
    """
    if alert.state is AlertState.RESOLVED or not alert.name or not alert.camera:  # of silence, or of a site's objects
        return None
    view = inventory.camera(CameraKey(alert.robot, alert.camera))
    if view is None:
        return alert.raised_ns
    return None if inventory.is_available(view, now_ns) else view.last_ns or alert.raised_ns
