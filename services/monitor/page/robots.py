"""How robots are, and which of thousands a page shows. Pure: all of it is made of a picture."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from services.monitor.page.words import NS, lasting, natural
from services.monitor.picture import CameraLine, Picture, RobotLine

QUIET_NS: Final = 5 * NS
"""A gateway says every second how it is; one that said nothing for so long is not relied on, though it is there."""


class RobotState(StrEnum):
    """How a robot is, the worst first. What is OFFLINE or SILENT is not available."""

    OFFLINE = "offline"
    """Its gateway is gone."""
    SILENT = "silent"
    """Its gateway is there, but nobody says what its cameras see now."""
    TROUBLE = "trouble"
    """It works, but not all of it."""
    ONLINE = "online"


WORST_FIRST: Final = {state: place for place, state in enumerate(RobotState)}


@dataclass(frozen=True, slots=True)
class Robot:
    """One robot. why: what keeps it from being online, in words."""

    line: RobotLine
    cameras: tuple[CameraLine, ...]
    state: RobotState
    why: str


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which robots are to be shown: `text` is in their names or a camera's or class's; all states unless given."""

    text: str = ""
    state: RobotState | None = None
    sort: str = "state"
    descending: bool = False


class Survey:
    """All robots of a picture: counted, searched and sorted. What was asked for once is kept, as many ask the same."""

    def __init__(self, picture: Picture) -> None:
        of_robot = defaultdict[str, list[CameraLine]](list)
        for camera in picture.cameras:
            of_robot[camera.key.robot].append(camera)
        lines = sorted(picture.robots, key=lambda line: natural(line.name))
        self._robots = [_robot(line, of_robot.get(line.name, ()), picture.now_ns) for line in lines]
        self._kept: dict[Wanted, Sequence[Robot]] = {}
        self.picture = picture
        self.counts: Mapping[RobotState, int] = Counter(robot.state for robot in self._robots)
        self.live_cameras = sum(not camera.row.stale for camera in picture.cameras)
        self.rate_hz = sum(line.rate_hz for line in picture.robots)

    def robots(self, wanted: Wanted) -> Sequence[Robot]:
        """Return the robots that are wanted in the order that is."""
        if wanted not in self._kept:
            text = wanted.text.strip().casefold()
            found = [
                robot
                for robot in self._robots
                if wanted.state in (None, robot.state) and (not text or _has(robot, text))
            ]
            self._kept[wanted] = sorted(found, key=SORTS.get(wanted.sort, SORTS["state"]), reverse=wanted.descending)
        return self._kept[wanted]


SORTS: Final[Mapping[str, Callable[[Robot], Any]]] = {
    "state": lambda robot: WORST_FIRST[robot.state],
    "robot": lambda robot: natural(robot.line.name),
    "seen": lambda robot: robot.line.last_ns,
    "rate": lambda robot: robot.line.rate_hz,
    "age": lambda robot: float("inf") if robot.line.age_s is None else robot.line.age_s,
    "dropped": lambda robot: sum(robot.line.dropped.values()),
}


def standing(line: RobotLine, cameras: Sequence[CameraLine], now_ns: int) -> tuple[RobotState, str]:
    """Return how a robot is, and why it is not online, in words."""
    if not line.online:
        return RobotState.OFFLINE, "its gateway is gone"
    if not line.last_ns:
        return RobotState.SILENT, "nothing heard yet"
    silent_ns = now_ns - line.last_ns
    if silent_ns > QUIET_NS:
        return RobotState.SILENT, f"nothing heard for {lasting(silent_ns / NS)}"
    there = [camera for camera in cameras if camera.row.online]
    if there and all(camera.row.stale for camera in there):
        return RobotState.SILENT, line.problems[0] if line.problems else _unseen(there)
    return (RobotState.TROUBLE, line.problems[0]) if line.problems else (RobotState.ONLINE, "")


def _unseen(cameras: Sequence[CameraLine]) -> str:
    """Say why nothing is known of cameras that are there."""
    workers = sorted({name for camera in cameras for name in camera.served_by if name.startswith("detector/")})
    return f"no class lists from {', '.join(workers)}" if workers else "no detector looks after its cameras"


def _robot(line: RobotLine, cameras: Sequence[CameraLine], now_ns: int) -> Robot:
    state, why = standing(line, cameras, now_ns)
    return Robot(line, tuple(cameras), state, why)


def _has(robot: Robot, text: str) -> bool:
    return text in robot.line.name.casefold() or any(
        text in camera.key.camera.casefold() or any(text in each.name.casefold() for each in camera.row.classes or ())
        for camera in robot.cameras
    )
