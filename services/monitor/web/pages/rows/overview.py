"""Robots on the overview and on the wall screen. Pure."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Final, TypeVar

from schemas.alerts import Alert, AlertState, Severity
from services.monitor.liveness import RobotState
from services.monitor.snapshot import CameraLine
from services.monitor.web.pages.rows.alerts import most_urgent_first
from services.monitor.web.pages.rows.formatting import age_text, ago, iso, plural, rate_text
from services.monitor.web.pages.rows.health import dropped_cells
from services.monitor.web.pages.rows.robots import RobotRow

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


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PageSlice:
    """One page of items that do not all fit. first: the index of the first of `items` among all `count`."""

    first: int
    size: int
    count: int

    def __str__(self) -> str:
        """Return the range of the items; empty if all are shown."""
        if self.size == self.count:
            return ""
        return f"{self.first + 1:,}-{self.first + self.size:,} of {self.count:,}"


def turned(items: Sequence[T], fit: int, turn: int) -> tuple[Sequence[T], PageSlice]:
    """Return the items of a turn; turns cycle through all pages."""
    pages = max(1, -(-len(items) // fit))
    first = turn % pages * fit
    shown = items[first : first + fit]
    return shown, PageSlice(first, len(shown), len(items))


def pressing(alerts: Sequence[Alert], lost: Sequence[str]) -> list[Alert | str]:
    """Return the items that need attention: critical alerts, then lost robots without such an alert."""
    critical = most_urgent_first(each for each in alerts if each.severity is Severity.CRITICAL)
    told = {each.robot for each in critical if not each.name and not each.camera}
    return [*critical, *(name for name in lost if name not in told)]


def alert_line(alert: Alert, doubt: str, now_ns: int) -> str:
    """Return an alert as a line. doubt: why its condition is unconfirmed, if it is."""
    state = "" if alert.state is AlertState.RAISED else f"{alert.state}, "
    badge = f'<span class="fs-severity fs-{alert.severity}">{alert.severity}</span>'
    said = f"{alert.text}, {doubt}" if doubt else alert.text
    return _line(badge, said, f"{state}{ago(alert.raised_ns, now_ns)}", stale=bool(doubt))


def lost_line(robot: RobotRow, now_ns: int) -> str:
    """Return a lost robot as a line."""
    badge = f'<span class="fs-state fs-{robot.state}"><span class="fs-dot fs-{robot.state}"></span>{robot.state}</span>'
    return _line(badge, f"{robot.line.name}: {robot.why}", f"last seen {ago(robot.line.last_ns, now_ns)}")


def _line(badge: str, said: str, when: str, *, stale: bool = False) -> str:
    return (
        f'<div class="fs-need {"fs-stale" if stale else ""}">{badge}{_cut(said)}'
        f'<span class="fs-when">{escape(when)}</span></div>'
    )


def robot_cell(robot: RobotRow) -> str:
    """Return an online robot as a cell: its state, problems, and the objects in view."""
    why = _cut(robot.why, "fs-why") if robot.why else ""
    return (
        f'<div class="fs-cell" data-robot="{escape(robot.line.name)}"><div class="fs-who-is">'
        f'<span class="fs-dot fs-{robot.state}"></span>{_cut(robot.line.name, "fs-name")}</div>'
        f"{why}{_cut(in_view(robot), 'fs-seen')}</div>"
    )


def in_view(robot: RobotRow) -> str:
    """Return the objects in view of a robot's live cameras, the most first, and whether several cameras add up."""
    live = [each.row.classes for each in robot.cameras if not each.row.stale and each.row.classes is not None]
    if not live:
        return "objects in view are unknown"
    counts = Counter[str]()
    for classes in live:
        counts.update({seen.name: seen.count for seen in classes})
    seen = ", ".join(f"{count} {name}" for name, count in counts.most_common())
    return f"{seen} in {len(live)} views" if seen and len(live) > 1 else seen or "nothing in view"


def _cut(text: str, name: str = "") -> str:
    """Return text that ends in an ellipsis where there is no room, with all of it as its title."""
    return f'<span class="fs-cut {name}" title="{escape(text)}">{escape(text)}</span>'
