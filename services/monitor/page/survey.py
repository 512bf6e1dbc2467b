"""Which of thousands of robots a page shows, in which order, and how many there are of each state."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from schemas.keys import CameraKey
from services.monitor.glance import Glance
from services.monitor.natural_order import cameras_in_order, natural
from services.monitor.page.robots import DETECTOR, Robot, RobotState, Standing, robot_of
from services.monitor.turns import in_turns

WORST_FIRST: Final = {state: place for place, state in enumerate(RobotState)}

SORTS: Final[Mapping[str, Callable[[Standing], Any]]] = {
    "state": lambda each: WORST_FIRST[each.state],
    "robot": lambda each: natural(each.name),
    "seen": lambda each: each.last_ns,
    "rate": lambda each: each.rate_hz,
    "age": lambda each: each.age_s,
}


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which robots are to be shown: `text` is in their names or a camera's or class's; all states unless given."""

    text: str = ""
    state: RobotState | None = None
    sort: str = "state"
    descending: bool = False


class Survey:
    """All robots at one moment: counted, searched, sorted and shown, so that what is counted is what is shown.

    now_ns: that moment, epoch. What was asked for once is kept, as many ask the same.
    """

    def __init__(self, glance: Glance, standings: Sequence[Standing]) -> None:
        self._glance = glance
        self._standings = standings
        self._by_name = {each.name: each for each in standings}
        self.now_ns = glance.now_ns
        self._kept: dict[Wanted, Sequence[str]] = {}
        self._unserved: Sequence[CameraKey] | None = None
        self.counts: Mapping[RobotState, int] = Counter(each.state for each in standings)
        self.cameras = len(glance.cameras)
        self.live_cameras = sum(each.live for each in standings)
        self.rate_hz = sum(each.rate_hz for each in standings)

    @property
    def size(self) -> int:
        """How many robots there are."""
        return len(self._standings)

    def robot(self, name: str) -> Robot:
        """Return all that is shown of a robot."""
        return robot_of(self._glance, self._by_name[name])

    async def robots(self, wanted: Wanted) -> Sequence[str]:
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


def _is_unserved(glance: Glance, key: CameraKey) -> bool:
    return glance.fleet.inventory.online(key) and not any(
        name.startswith(DETECTOR) for name in glance.workers.serving(key)
    )
