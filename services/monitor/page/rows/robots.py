"""How robots are, at a glance for all of them, and in full for those that are shown. Pure."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from typing import Any, Final, NamedTuple

from schemas.keys import CameraKey
from services.monitor.event_loop import in_turns
from services.monitor.fleet import Row
from services.monitor.formats import cameras_in_order, natural, natural_camera
from services.monitor.page.formatting import NS, lasting
from services.monitor.snapshot import CameraLine, FleetView, RobotLine

QUIET_NS: Final = 5 * NS
"""A gateway says every second how it is; one that said nothing for so long is not relied on, though it is there."""


DETECTOR: Final = "detector/"
"""What the names of workers begin with that say what cameras see."""


class RobotState(StrEnum):
    """How a robot is, the worst first. What is OFFLINE or SILENT is not available."""

    OFFLINE = "offline"
    """Its gateway is gone."""
    SILENT = "silent"
    """Its gateway is there, but nobody says what its cameras see now."""
    TROUBLE = "trouble"
    """It works, but not all of it."""
    ONLINE = "online"


@dataclass(frozen=True, slots=True)
class RobotRow:
    """One robot. why: what keeps it from being online, in words."""

    line: RobotLine
    cameras: tuple[CameraLine, ...]
    state: RobotState
    why: str


class Standing(NamedTuple):
    """One robot at the moment of a survey: what it is counted, sorted and shown by.

    rows: its cameras. last_ns, problems, age_s, rate_hz: as RobotLine has them. live: how many cameras are not stale.
    """

    name: str
    state: RobotState
    rows: tuple[Row, ...]
    problems: tuple[str, ...]
    last_ns: int
    age_s: float
    rate_hz: float
    live: int


def standings_of(glance: FleetView) -> Iterator[Standing]:
    """Yield how each robot is, by name as people sort names."""
    of_robot = by_robot(glance.cameras)
    for name in in_natural_order(glance.robots):
        keys = of_robot.get(name, ())
        rows = tuple([glance.row(key) for key in keys])
        last_ns = glance.last_ns(name, keys)
        problems = tuple(glance.fleet.problems_of(name))
        online = glance.fleet.inventory.is_alive(name)
        state = state_of(rows, glance.now_ns - last_ns, online=online, wrong=bool(problems))
        age_s = min((row.age.seconds for row in rows if row.age is not None), default=float("inf"))
        live = sum(not row.stale for row in rows)
        yield Standing(name, state, rows, problems, last_ns, age_s, sum(row.rate_hz for row in rows), live)


@lru_cache(maxsize=2)
def by_robot(cameras: tuple[CameraKey, ...]) -> Mapping[str, Sequence[CameraKey]]:
    """Return each robot's cameras, as people sort names; those of a fleet are the same for hours."""
    of_robot = defaultdict[str, list[CameraKey]](list)
    for key in cameras:
        of_robot[key.robot].append(key)
    return {robot: sorted(keys, key=natural_camera) for robot, keys in of_robot.items()}


@lru_cache(maxsize=2)
def in_natural_order(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names as people sort them; that of a fleet is the same for hours."""
    return tuple(sorted(names, key=natural))


def state_of(rows: Sequence[Row], silent_ns: int, *, online: bool, wrong: bool) -> RobotState:
    """Return how a robot is. rows: its cameras. silent_ns: since it was heard last. wrong: something is."""
    if not online:
        return RobotState.OFFLINE
    if silent_ns > QUIET_NS:
        return RobotState.SILENT
    there = [row for row in rows if row.online]
    if there and all(row.stale for row in there):
        return RobotState.SILENT
    return RobotState.TROUBLE if wrong else RobotState.ONLINE


def robot_of(glance: FleetView, of: Standing) -> RobotRow:
    """Return all that is shown of a robot, with the state that it is counted with."""
    cameras = tuple(glance.camera_of(row) for row in of.rows)
    line = replace(
        glance.robot_of(of.name, cameras),
        online=of.state is not RobotState.OFFLINE,
        last_ns=of.last_ns,
        problems=of.problems,
    )
    return RobotRow(line, cameras, *standing(line, cameras, glance.now_ns))


def standing(line: RobotLine, cameras: Sequence[CameraLine], now_ns: int) -> tuple[RobotState, str]:
    """Return how a robot is, and why it is not online, in words."""
    silent_ns = now_ns - line.last_ns
    state = state_of([each.row for each in cameras], silent_ns, online=line.online, wrong=bool(line.problems))
    match state:
        case RobotState.OFFLINE:
            return state, "its gateway is gone"
        case RobotState.SILENT if not line.last_ns:
            return state, "nothing heard yet"
        case RobotState.SILENT if silent_ns > QUIET_NS:
            return state, f"nothing heard for {lasting(silent_ns / NS)}"
        case RobotState.SILENT if not line.problems:
            return state, _unseen([camera for camera in cameras if camera.row.online])
    return state, line.problems[0] if line.problems else ""


def _unseen(cameras: Sequence[CameraLine]) -> str:
    """Say why nothing is known of cameras that are there."""
    served_by = {name for camera in cameras for name in camera.served_by if name.startswith(DETECTOR)}
    workers = sorted(served_by, key=natural)
    return f"no class lists from {', '.join(workers)}" if workers else "no detector serves its cameras"


WORST_FIRST: Final = {state: place for place, state in enumerate(RobotState)}

SORTS: Final[Mapping[str, Callable[[Standing], Any]]] = {
    "state": lambda each: WORST_FIRST[each.state],
    "robot": lambda each: natural(each.name),
    "seen": lambda each: each.last_ns,
    "rate": lambda each: each.rate_hz,
    "age": lambda each: each.age_s,
}


@dataclass(frozen=True, slots=True)
class RobotFilter:
    """Which robots are to be shown: `text` is in their names or a camera's or class's; all states unless given."""

    text: str = ""
    state: RobotState | None = None
    sort: str = "state"
    descending: bool = False


class Survey:
    """All robots at one moment: counted, searched, sorted and shown, so that what is counted is what is shown.

    now_ns: that moment, epoch. What was asked for once is kept, as many ask the same.
    """

    def __init__(self, glance: FleetView, standings: Sequence[Standing]) -> None:
        self._glance = glance
        self._standings = standings
        self._by_name = {each.name: each for each in standings}
        self.now_ns = glance.now_ns
        self._kept: dict[RobotFilter, Sequence[str]] = {}
        self._unserved: Sequence[CameraKey] | None = None
        self.counts: Mapping[RobotState, int] = Counter(each.state for each in standings)
        self.cameras = len(glance.cameras)
        self.live_cameras = sum(each.live for each in standings)
        self.rate_hz = sum(each.rate_hz for each in standings)

    @property
    def size(self) -> int:
        """How many robots there are."""
        return len(self._standings)

    def robot(self, name: str) -> RobotRow:
        """Return all that is shown of a robot."""
        return robot_of(self._glance, self._by_name[name])

    async def robots(self, wanted: RobotFilter) -> Sequence[str]:
        """Return the names of the robots that are wanted in the order that is."""
        if wanted not in self._kept:
            text = wanted.text.strip().casefold()
            found = [each for each in self._standings if wanted.state in (None, each.state)]
            if text:
                found = [each async for each in in_turns(found) if _has(each, text)]
            if wanted.sort == "dropped":
                drops = {each.name: self._drops(each.name) async for each in in_turns(found)}
                found.sort(key=lambda each: drops[each.name], reverse=wanted.descending)
            else:
                found.sort(key=SORTS.get(wanted.sort, SORTS["state"]), reverse=wanted.descending)
            self._kept[wanted] = [each.name for each in found]
        return self._kept[wanted]

    async def unserved(self) -> Sequence[CameraKey]:
        """Return the cameras that are there and that no detector looks after."""
        if self._unserved is None:
            self._unserved = [
                key async for key in in_turns(cameras_in_order(self._glance.cameras)) if _is_unserved(self._glance, key)
            ]
        return self._unserved

    def _drops(self, name: str) -> int:
        return self._glance.drops(name, self._glance.cameras_of(name))


def _has(robot: Standing, text: str) -> bool:
    return text in robot.name.casefold() or any(
        text in row.key.camera.casefold() or any(text in each.name.casefold() for each in row.classes or ())
        for row in robot.rows
    )


def _is_unserved(glance: FleetView, key: CameraKey) -> bool:
    return glance.fleet.inventory.online(key) and not any(
        name.startswith(DETECTOR) for name in glance.workers.serving(key)
    )
