"""States of robots: in brief for all of them, and in full for those that are shown. Pure."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final, NamedTuple

from schemas.keys import CameraKey
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.fleet import Row
from services.monitor.formats import cameras_in_order, natural, natural_camera
from services.monitor.liveness import ROBOT_SILENT_NS, RobotState, robot_state
from services.monitor.snapshot import CameraLine, FleetView, RobotLine
from services.monitor.web.pages.rows.formatting import NS, lasting

DETECTOR: Final = "detector/"
"""Name prefix of workers that report class lists."""


@dataclass(frozen=True, slots=True)
class RobotRow:
    """One robot. why: why it is not online, in words."""

    line: RobotLine
    cameras: tuple[CameraLine, ...]
    state: RobotState
    why: str


class RobotSummary(NamedTuple):
    """One robot in a survey, with the keys for counting, sorting and showing it.

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


def robot_summaries(fleet_view: FleetView) -> Iterator[RobotSummary]:
    """Yield the standing of each robot, by name in natural order."""
    of_robot = by_robot(fleet_view.cameras)
    for name in in_natural_order(fleet_view.robots):
        keys = of_robot.get(name, ())
        rows = tuple([fleet_view.row(key) for key in keys])
        last_ns = fleet_view.last_ns(name, keys)
        problems = tuple(fleet_view.fleet.problems_of(name))
        online = fleet_view.fleet.inventory.is_alive(name)
        state = state_of(rows, fleet_view.now_ns - last_ns, online=online, wrong=bool(problems))
        age_s = min((row.age.seconds for row in rows if row.age is not None), default=float("inf"))
        live = sum(not row.stale for row in rows)
        yield RobotSummary(name, state, rows, problems, last_ns, age_s, sum(row.rate_hz for row in rows), live)


@lru_cache(maxsize=2)
def by_robot(cameras: tuple[CameraKey, ...]) -> Mapping[str, Sequence[CameraKey]]:
    """Return each robot's cameras in natural order; cached, as a fleet's names rarely change."""
    of_robot = defaultdict[str, list[CameraKey]](list)
    for key in cameras:
        of_robot[key.robot].append(key)
    return {robot: sorted(keys, key=natural_camera) for robot, keys in of_robot.items()}


@lru_cache(maxsize=2)
def in_natural_order(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names in natural order; cached, as a fleet's names rarely change."""
    return tuple(sorted(names, key=natural))


def state_of(rows: Sequence[Row], silent_ns: int, *, online: bool, wrong: bool) -> RobotState:
    """Return the state of a robot. rows: its cameras. silent_ns: since its last message. wrong: it has problems."""
    return robot_state(silent_ns, (row.stale for row in rows if row.online), online=online, has_problem=wrong)


def robot_of(fleet_view: FleetView, of: RobotSummary) -> RobotRow:
    """Return the full data of a robot, with the state under which it is counted."""
    cameras = tuple(fleet_view.camera_of(row) for row in of.rows)
    line = replace(
        fleet_view.robot_of(of.name, cameras),
        online=of.state is not RobotState.OFFLINE,
        last_ns=of.last_ns,
        problems=of.problems,
    )
    return RobotRow(line, cameras, *standing(line, cameras, fleet_view.now_ns))


def standing(line: RobotLine, cameras: Sequence[CameraLine], now_ns: int) -> tuple[RobotState, str]:
    """Return the state of a robot, and why it is not online, in words."""
    silent_ns = now_ns - line.last_ns
    state = state_of([each.row for each in cameras], silent_ns, online=line.online, wrong=bool(line.problems))
    match state:
        case RobotState.OFFLINE:
            return state, "its gateway is gone"
        case RobotState.SILENT if not line.last_ns:
            return state, "nothing heard yet"
        case RobotState.SILENT if silent_ns > ROBOT_SILENT_NS:
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

SORTS: Final[Mapping[str, Callable[[RobotSummary], Any]]] = {
    "state": lambda each: WORST_FIRST[each.state],
    "robot": lambda each: natural(each.name),
    "seen": lambda each: each.last_ns,
    "rate": lambda each: each.rate_hz,
    "age": lambda each: each.age_s,
}


@dataclass(frozen=True, slots=True)
class RobotFilter:
    """Selects robots: `text` is in their names or a camera's or class's; all states unless given."""

    text: str = ""
    state: RobotState | None = None
    sort: str = "state"
    descending: bool = False


class Survey:
    """All robots at one moment: counts, search, order and rows agree with each other.

    now_ns: that moment, epoch. Results are cached, as many viewers ask for the same.
    """

    def __init__(self, fleet_view: FleetView, summaries: Sequence[RobotSummary]) -> None:
        self._fleet_view = fleet_view
        self._summaries = summaries
        self._by_name = {each.name: each for each in summaries}
        self.now_ns = fleet_view.now_ns
        self._kept: dict[RobotFilter, Sequence[str]] = {}
        self._unserved: Sequence[CameraKey] | None = None
        self.counts: Mapping[RobotState, int] = Counter(each.state for each in summaries)
        self.cameras = len(fleet_view.cameras)
        self.live_cameras = sum(each.live for each in summaries)
        self.rate_hz = sum(each.rate_hz for each in summaries)

    @property
    def size(self) -> int:
        """The number of robots."""
        return len(self._summaries)

    def robot(self, name: str) -> RobotRow:
        """Return the full data of a robot."""
        return robot_of(self._fleet_view, self._by_name[name])

    async def robots(self, wanted: RobotFilter) -> Sequence[str]:
        """Return the names of the selected robots in the given order."""
        if wanted not in self._kept:
            text = wanted.text.strip().casefold()
            found = [each for each in self._summaries if wanted.state in (None, each.state)]
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
        """Return the online cameras that no detector serves."""
        if self._unserved is None:
            self._unserved = [
                key
                async for key in in_turns(cameras_in_order(self._fleet_view.cameras))
                if _is_unserved(self._fleet_view, key)
            ]
        return self._unserved

    def _drops(self, name: str) -> int:
        return self._fleet_view.drops(name, self._fleet_view.cameras_of(name))


def _has(robot: RobotSummary, text: str) -> bool:
    return text in robot.name.casefold() or any(
        text in row.key.camera.casefold() or any(text in each.name.casefold() for each in row.classes or ())
        for row in robot.rows
    )


def _is_unserved(fleet_view: FleetView, key: CameraKey) -> bool:
    return fleet_view.fleet.inventory.online(key) and not any(
        name.startswith(DETECTOR) for name in fleet_view.workers.serving(key)
    )
