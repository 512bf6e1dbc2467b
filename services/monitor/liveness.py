"""When a robot, camera, worker, view or pose is online, stale, silent, lost or available. Pure: time is an argument.

This module has the definitions and thresholds; every other module asks it.

| state | of | condition | threshold | setting |
|---|---|---|---|---|
| online | robot | its gateway's liveliness token is there | lease of the link | `--lease-s` |
| online | camera | its own token and that of its robot's gateway are there | lease of the link | `--lease-s` |
| online | worker | its newest status is recent | WORKER_ONLINE_NS, 3 s | none: workers report every second |
| offline | robot, camera, worker | not online | | |
| stale | camera | offline, or its newest class list is older | STALE_S, 3 s | `--stale-s` |
| silent | camera | online and stale, after at least one class list | STALE_S, 3 s | `--stale-s` |
| silent | robot | online, but no message from it, or every online camera is stale | ROBOT_SILENT_NS, 5 s | none |
| available | camera, view | online and not lost, MIN_LISTS lists, the newest recent | STALE_S, 3 s | `--stale-s` |
| lost | view of a camera | no class list | LOST_S, 60 s | `--lost-s` |
| live | pose of a robot | online, and the pose is recent | POSE_LIVE_NS, 5 s | none |
| fresh | object on the map | seen recently | OBJECT_FRESH_NS, 10 s | none |
| deaf | monitor | its own heartbeat is late, or it has no link | lease + 2 x HEARTBEAT_S | `--lease-s` |
| settled | monitor | not deaf, and all who are there had time to appear | SETTLE_NS, 3 s + lease | `--lease-s` |
| stalled | monitor | its own heartbeat is late enough to be reported | STALLED_S, 10 s | none |

Alerts about silent cameras and offline robots also wait until the monitor has heard its own heartbeat NETWORK_GRACE_S
after the silence began: see `services.monitor.inventory.availability`.
"""

from collections.abc import Callable, Iterable
from enum import StrEnum
from typing import Final

SECOND_NS: Final = 1_000_000_000

STALE_S: Final = 3.0
"""Default of `--stale-s`: age of a camera's newest class list from which its view is stale."""

LOST_S: Final = 60.0
"""Default of `--lost-s`: time without a class list after which the view of a camera is unknown."""

MIN_LISTS: Final = 2
"""Class lists before a view is available: the first may be the one kept for late subscribers."""

ROBOT_SILENT_NS: Final = 5 * SECOND_NS
"""Gateways report every second; a robot without a message for longer is silent, although it is online."""

WORKER_ONLINE_NS: Final = 3 * SECOND_NS
"""Workers report every second; one without a status for longer is offline."""

POSE_LIVE_NS: Final = 5 * SECOND_NS
OBJECT_FRESH_NS: Final = 10 * SECOND_NS

SETTLE_NS: Final = 3 * SECOND_NS
"""Time after the start of a monitor, or after a lost link, in which all who are there appear."""

HEARTBEAT_S: Final = 1.0
"""Seconds between two heartbeats that the monitor sends to itself."""

NETWORK_GRACE_S: Final = 1.0
"""Maximum delay, in seconds, between the fleet's disappearance and the detection of a lost link."""

STALLED_S: Final = 10.0
"""Seconds without its own heartbeat after which the monitor reports that it cannot hear the fleet."""


class CameraLiveness(StrEnum):
    """The state of a camera. One without any class list yet is online, not silent."""

    OFFLINE = "offline"
    SILENT = "silent"
    ONLINE = "online"


class RobotState(StrEnum):
    """The state of a robot, the worst first. OFFLINE and SILENT robots are not available."""

    OFFLINE = "offline"
    """Its gateway is gone."""
    SILENT = "silent"
    """Its gateway is online, but no current class lists arrive from its cameras."""
    TROUBLE = "trouble"
    """It works, but not all of it."""
    ONLINE = "online"


def is_recent(last_ns: int, now_ns: int, limit_ns: int) -> bool:
    """Whether something last heard at `last_ns` is no older than the limit."""
    return now_ns - last_ns <= limit_ns


def is_stale(age_s: float | None, stale_s: float, *, online: bool) -> bool:
    """Whether what a camera shows may be outdated. age_s: of its newest class list, None before the first."""
    return not online or age_s is None or age_s > stale_s


def camera_state(age_s: float | None, stale_s: float, *, online: bool) -> CameraLiveness:
    """Return the state of a camera. age_s: of its newest class list, None before the first."""
    if not online:
        return CameraLiveness.OFFLINE
    is_silent = age_s is not None and is_stale(age_s, stale_s, online=online)
    return CameraLiveness.SILENT if is_silent else CameraLiveness.ONLINE


def robot_state(unheard_ns: int, stale_cameras: Iterable[bool], *, online: bool, has_problem: bool) -> RobotState:
    """Return the state of a robot. unheard_ns: since its last message. stale_cameras: of each online camera."""
    if not online:
        return RobotState.OFFLINE
    if unheard_ns > ROBOT_SILENT_NS:
        return RobotState.SILENT
    stale = list(stale_cameras)
    if stale and all(stale):
        return RobotState.SILENT
    return RobotState.TROUBLE if has_problem else RobotState.ONLINE


def is_worker_online(last_ns: int, now_ns: int) -> bool:
    """Whether a worker is online. last_ns: arrival of its newest status."""
    return is_recent(last_ns, now_ns, WORKER_ONLINE_NS)


def is_view_current(lists: int, last_ns: int, since_ns: int, *, lost: bool) -> bool:
    """Whether a view is current, and so available if its camera is online. last_ns: of the newest of its lists."""
    return lists >= MIN_LISTS and last_ns >= since_ns and not lost


def is_pose_live(at_ns: int, now_ns: int, *, online: bool) -> bool:
    """Whether a robot is where its pose says. at_ns: arrival of the pose."""
    return online and is_recent(at_ns, now_ns, POSE_LIVE_NS)


class Heartbeat:
    """Tracks whether the monitor hears the fleet. Seconds are of the steady clock.

    heard: when the monitor heard a message of its own last, None while it knows that it cannot hear the fleet.
    lease_s: after how long a link counts as lost: as much later than the monitor's own others may notice theirs.
    deaf: the fleet is not heard. settled: it is, and all who are there had time to appear.
    """

    def __init__(self, heard: Callable[[], float | None], lease_s: float) -> None:
        self._heard = heard
        self.lease_s = lease_s
        self._late_s = lease_s + 2 * HEARTBEAT_S
        self._settle_s = SETTLE_NS / SECOND_NS + lease_s
        self._settled_s = 0.0
        self.heard_s = 0.0
        self.deaf = False
        self.settled = True

    def advance(self, now_s: float) -> bool:
        """Advance time; return whether the monitor became deaf, hears again or has settled.

        A late heartbeat makes it deaf, too: the process was held up, and messages of the fleet may have been as well.
        """
        before = (self.deaf, self.settled)
        heard_s = self._heard()
        deaf = heard_s is None or now_s - heard_s > self._late_s
        if self.deaf and not deaf:
            self._settled_s = now_s + self._settle_s
        self.heard_s = self.heard_s if heard_s is None else heard_s
        self.deaf = deaf
        self.settled = not deaf and now_s >= self._settled_s
        return (self.deaf, self.settled) != before
