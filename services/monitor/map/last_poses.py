"""The last known poses of robots. Pure: time is an argument."""

from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

from services.monitor.inventory.inventory import MAX_MEMBERS
from services.monitor.map.pose import DrawnRobot, Pose
from services.monitor.map.sighting_places import FORGET_NS

LOST_NS: Final = 5_000_000_000
"""Age from which a pose is no longer current."""

MAX_POSES: Final = MAX_MEMBERS
"""Maximum number of poses kept, the newest ones: as many as robots are followed."""


@dataclass(frozen=True, slots=True)
class _Known:
    pose: Pose
    known_ns: int


class LastPoses:
    """The newest pose of every robot; kept, once out of date, for as long as objects are.

    is_forgotten: whether nobody misses a robot, however lately its pose was known.
    """

    def __init__(self, is_forgotten: Callable[[str], bool] = lambda _: False) -> None:
        self._is_forgotten = is_forgotten
        self._known: OrderedDict[str, _Known] = OrderedDict()

    def take(self, poses: Mapping[str, Pose], now_ns: int) -> None:
        """Take current poses."""
        for name, pose in poses.items():
            self._known[name] = _Known(pose, now_ns)
            self._known.move_to_end(name)
        while len(self._known) > MAX_POSES:
            self._known.popitem(last=False)

    def take_seen(self, poses: Mapping[str, Pose]) -> None:
        """Take poses of any age, but only those newer than the known ones, though a clock was set back."""
        for name, pose in poses.items():
            known = self._known.get(name)
            if known is None or known.pose.at_ns != pose.at_ns:
                self.take({name: pose}, pose.at_ns)

    def names(self, now_ns: int) -> set[str]:
        """Return the robots with a pose."""
        lately = {name for name, known in self._known.items() if now_ns - known.known_ns <= FORGET_NS}
        return {name for name in lately if not self._is_forgotten(name)}

    def robots(self, now_ns: int, online: Collection[str], *, robot: str = "") -> list[DrawnRobot]:
        """Return the robots with a pose, by name; one of them if it is named.

        Live are those that are online and were heard just now.
        """
        wanted = sorted(name for name in self.names(now_ns) if robot in ("", name))
        poses = ((name, self._known[name].pose) for name in wanted)
        return [DrawnRobot(name, pose, live=name in online and now_ns - pose.at_ns <= LOST_NS) for name, pose in poses]
