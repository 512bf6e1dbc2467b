"""Robots, cameras and workers as they are shown, for tests."""

from collections.abc import Sequence

from schemas.detections import ClassCount
from schemas.keys import CameraKey
from schemas.status import CameraLoad, GatewayStatus, StreamStatus, WorkerStatus
from services.monitor.fleet import Age, Row
from services.monitor.snapshot import CameraLine, RobotLine, WorkerLine
from services.monitor.web.pages.rows.robots import RobotRow, standing

S = 1_000_000_000
NOW = 1_000 * S


def camera(
    robot: str = "r1",
    name: str = "front",
    *,
    online: bool = True,
    age_s: float | None = 0.5,
    classes: Sequence[tuple[str, int]] = (("box", 2),),
    served_by: tuple[str, ...] = ("detector/gpu-1",),
) -> CameraLine:
    """Return a camera that available, unless told otherwise."""
    row = Row(
        key=CameraKey(robot, name),
        online=online,
        classes=None if age_s is None else tuple(ClassCount(each, count, 0.9) for each, count in classes),
        age=None if age_s is None else Age(age_s, exact=True),
        rate_hz=2.0,
    )
    return CameraLine(row, 0 if age_s is None else NOW - round(age_s * S), {}, served_by)


def robot(
    name: str = "r1",
    *,
    online: bool = True,
    last_ns: int = NOW,
    problems: tuple[str, ...] = (),
    streams: Sequence[StreamStatus] = (),
    age_s: float | None = 0.5,
) -> RobotLine:
    """Return a robot that was heard just now, unless told otherwise."""
    gateway = GatewayStatus(robot=name, boot_id="b", clock_id="c", sent_ns=0, streams=list(streams), version="0.9")
    return RobotLine(
        name=name,
        online=online,
        last_ns=last_ns,
        gateway=gateway,
        problems=problems,
        cameras=("front",),
        age_s=age_s,
        rate_hz=2.0,
        dropped={"gateway: late": 3, "gateway: thinned": 1_200},
    )


def worker(
    name: str = "gpu-1", *, online: bool = True, frames: int = 0, sent_ns: int = 0, cameras: int = 1
) -> WorkerLine:
    """Return a detector that serves cameras of r1."""
    loads = [
        CameraLoad(robot="r1", camera=f"c{number}", inferred=frames, dropped={"late": 2}, serving=True, budget_hz=5.0)
        for number in range(cameras)
    ]
    status = WorkerStatus(service="detector", worker=name, model="m", sent_ns=sent_ns, cameras=loads, version="0.8")
    return WorkerLine(status, online, NOW)


def shown(line: RobotLine, *cameras: CameraLine) -> RobotRow:
    """Return a robot as it is shown at NOW."""
    return RobotRow(line, cameras, *standing(line, cameras, NOW))
