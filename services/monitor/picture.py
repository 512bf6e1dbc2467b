"""The fleet at one moment, as people and programs are shown it. Pure."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from schemas.keys import CameraKey
from schemas.status import CameraLoad, GatewayStatus, WorkerStatus
from services.monitor.fleet import Fleet, Row
from services.monitor.inventory.settling import NS

SILENT_NS: Final = 3 * NS
"""After how long without a word a worker counts as gone: it has one every second."""


@dataclass(frozen=True, slots=True)
class CameraLine:
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
    """One robot. last_ns: when anything came from it last, epoch, our clock; 0 if nothing ever did.

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
    """One worker. last_ns: when its newest status came. online: it has said something in the last seconds."""

    status: WorkerStatus
    online: bool
    last_ns: int

    @property
    def name(self) -> str:
        """Its service and its own name."""
        return f"{self.status.service}/{self.status.worker}"

    @property
    def serves(self) -> tuple[CameraLoad, ...]:
        """What became of the cameras that it looks after now."""
        return tuple(load for load in self.status.cameras if load.serving) if self.online else ()


@dataclass(frozen=True, slots=True)
class Picture:
    """Everything at `now_ns`, robots, cameras and workers by name."""

    now_ns: int
    robots: tuple[RobotLine, ...]
    cameras: tuple[CameraLine, ...]
    workers: tuple[WorkerLine, ...]


class Painting:
    """A picture while it is made, camera by camera and robot by robot, so that others get their turn in between."""

    def __init__(self, fleet: Fleet, now_ns: int, now_s: float) -> None:
        self._fleet = fleet
        self._now_ns = now_ns
        self._now_s = now_s
        self._cameras: list[CameraLine] = []
        self._robots: list[RobotLine] = []
        self._of_robot: dict[str, list[CameraLine]] = defaultdict(list)
        self._workers = _workers(fleet, now_ns)

    def steps(self) -> Iterator[None]:
        """Yield after each step."""
        loads: dict[tuple[str, str], list[tuple[WorkerLine, CameraLoad]]] = defaultdict(list)
        for worker in self._workers:
            for load in worker.status.cameras:
                loads[load.robot, load.camera].append((worker, load))
            yield
        for row in self._fleet.rows(self._now_s):
            line = self._camera(row, loads[row.key.robot, row.key.camera])
            self._cameras.append(line)
            self._of_robot[row.key.robot].append(line)
            yield
        for name in sorted({*self._fleet.inventory.robots(), *self._fleet.gateways, *self._of_robot}):
            self._robots.append(self._robot(name))
            yield

    def picture(self) -> Picture:
        """Return it, once all steps are done."""
        return Picture(self._now_ns, tuple(self._robots), tuple(self._cameras), self._workers)

    def _camera(self, row: Row, loads: Sequence[tuple[WorkerLine, CameraLoad]]) -> CameraLine:
        dropped = _drops_of(self._fleet.gateways.get(row.key.robot), row.key.camera)
        for worker, load in loads:
            dropped.update({f"{worker.name}: {reason}": count for reason, count in load.dropped.items()})
        view = self._fleet.inventory.camera(row.key)
        served_by = tuple(worker.name for worker, load in loads if load.serving and worker.online)
        return CameraLine(row, 0 if view is None else view.last_ns, +dropped, served_by)

    def _robot(self, name: str) -> RobotLine:
        cameras, gateway = self._of_robot.get(name, []), self._fleet.gateways.get(name)
        dropped = _drops_of(gateway, "")
        if gateway is not None:
            dropped.update({f"gateway: {reason}": count for reason, count in gateway.withdrawn.items()})
        for camera in cameras:
            dropped.update(camera.dropped)
        ages = [camera.row.age.seconds for camera in cameras if camera.row.age is not None]
        return RobotLine(
            name=name,
            online=self._fleet.inventory.is_alive(name),
            last_ns=max([self._fleet.heard_ns.get(name, 0), *(camera.last_ns for camera in cameras)]),
            gateway=gateway,
            problems=() if gateway is None else tuple(_problems(gateway)),
            cameras=tuple(camera.key.camera for camera in cameras),
            age_s=min(ages, default=None),
            rate_hz=sum(camera.row.rate_hz for camera in cameras),
            dropped=+dropped,
        )


def _workers(fleet: Fleet, now_ns: int) -> tuple[WorkerLine, ...]:
    lines = (
        WorkerLine(status, now_ns - last_ns <= SILENT_NS, last_ns)
        for name, status in sorted(fleet.workers.items())
        for last_ns in [fleet.worker_heard_ns.get(name, 0)]
    )
    return tuple(lines)


def _drops_of(gateway: GatewayStatus | None, camera: str) -> Counter[str]:
    """Return what a gateway dropped of a camera's streams; of those that belong to the whole robot if it is empty."""
    dropped: Counter[str] = Counter()
    for stream in () if gateway is None else gateway.streams:
        if stream.camera == camera:
            dropped.update({f"gateway: {reason}": count for reason, count in stream.dropped.items()})
    return dropped


def _problems(gateway: GatewayStatus) -> Iterable[str]:
    if gateway.waiting_for:
        yield f"waits for {gateway.waiting_for}"
    yield from (f"{stream.name}: {stream.problem}" for stream in gateway.streams if stream.problem)
