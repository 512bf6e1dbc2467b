"""Robots as rows of the overview's table. Pure."""

from typing import Any, Final

from services.monitor.page.formatting import age_text, ago, iso, plural, rate_text
from services.monitor.page.rows.health import dropped_cells
from services.monitor.page.rows.robots import RobotRow, RobotState
from services.monitor.snapshot import CameraLine

MAX_CAMERAS: Final = 8
"""Maximum number of cameras shown per robot."""


def robot_row(robot: RobotRow, now_ns: int, *, may_act: bool) -> dict[str, Any]:
    """Return a robot as a row of the overview's templates, in tuples: nicegui would observe lists."""
    line, more = robot.line, len(robot.cameras) - MAX_CAMERAS
    return {
        "robot": line.name,
        "state": robot.state,
        "why": robot.why,
        "forgettable": may_act and robot.state is RobotState.OFFLINE,
        "seen": "now" if robot.state in (RobotState.ONLINE, RobotState.TROUBLE) else ago(line.last_ns, now_ns),
        "seen_at": iso(line.last_ns) if robot.state in (RobotState.OFFLINE, RobotState.SILENT) else "",
        "cameras": tuple(_camera(camera) for camera in robot.cameras[:MAX_CAMERAS]),
        "more": f"and {plural(more, 'camera')} more" if more > 0 else "",
        **dropped_cells(line.dropped),
    }


def _camera(camera: CameraLine) -> dict[str, Any]:
    row = camera.row
    return {
        "name": camera.key.camera,
        "online": row.online,
        "live": not row.stale,
        "classes": None if row.classes is None else [[each.count, each.name] for each in row.classes],
        "rate": rate_text(row.rate_hz),
        "age": age_text(row.age),
    }
