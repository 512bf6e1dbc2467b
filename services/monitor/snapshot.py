"""The fleet at one moment, as people and programs are shown it. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from schemas.keys import CameraKey
from schemas.status import CameraLoad, GatewayStatus, WorkerStatus
from services.monitor.fleet import Row


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
class Snapshot:
    """Everything at `now_ns`, robots, cameras and workers by name."""

    now_ns: int
    robots: tuple[RobotLine, ...]
    cameras: tuple[CameraLine, ...]
    workers: tuple[WorkerLine, ...]
