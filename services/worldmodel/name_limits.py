"""Limits on the names of a site's robots and cameras, counts by name, and numbers of names. Pure."""

from collections import Counter, OrderedDict
from collections.abc import Hashable, ItemsView, Iterable, Sequence
from typing import Final, Generic, TypeVar

from schemas.world import MAX_ROBOT_CAMERAS, MAX_ROBOTS

ABSENT_NS: Final = 600_000_000_000
"""A robot or camera without views for so long makes room for a new one, if room is needed."""

TOO_MANY_ROBOTS: Final = "views of new robots: the site has its most robots"
TOO_MANY_CAMERAS: Final = "views of new cameras: their robot has its most cameras"

CameraName = tuple[str, str]
"""Robot and camera."""

T = TypeVar("T", bound=Hashable)


class NameLimit:
    """Limits the robots and cameras whose views a site takes, because anybody can invent names.

    cameras: those that are known from before, as if they had sent a view at `now_ns`. most_robots: of the site.
    most_cameras: of each robot.
    """

    def __init__(
        self,
        cameras: Iterable[CameraName] = (),
        now_ns: int = 0,
        *,
        most_robots: int = MAX_ROBOTS,
        most_cameras: int = MAX_ROBOT_CAMERAS,
    ) -> None:
        self._most_robots = most_robots
        self._most_cameras = most_cameras
        self._robots: OrderedDict[str, OrderedDict[str, int]] = OrderedDict()  # the longest absent are first
        self._left_robots: list[str] = []
        self._left_cameras: list[CameraName] = []
        for robot, camera in cameras:
            self._robots.setdefault(robot, OrderedDict())[camera] = now_ns

    def admit(self, robot: str, camera: str, at_ns: int) -> str:
        """Note a view that came at `at_ns`; return why there is no room for its camera, or nothing."""
        cameras = self._robots.get(robot)
        if cameras is None:
            if len(self._robots) >= self._most_robots and not self._drop_robot(at_ns):
                return TOO_MANY_ROBOTS
            cameras = self._robots[robot] = OrderedDict()
        elif (
            camera not in cameras
            and len(cameras) >= self._most_cameras
            and not self._drop_camera(robot, cameras, at_ns)
        ):
            return TOO_MANY_CAMERAS
        cameras[camera] = at_ns
        cameras.move_to_end(camera)
        self._robots.move_to_end(robot)
        return ""

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        for cameras in self._robots.values():
            for camera, at_ns in cameras.items():
                cameras[camera] = min(at_ns, now_ns)

    def take_left(self) -> tuple[list[str], list[CameraName]]:
        """Return the robots, and the cameras, that made room since this was called last."""
        left = self._left_robots, self._left_cameras
        self._left_robots, self._left_cameras = [], []
        return left

    def _drop_robot(self, now_ns: int) -> bool:
        robot, cameras = next(iter(self._robots.items()))
        if next(reversed(cameras.values())) > now_ns - ABSENT_NS:
            return False
        del self._robots[robot]
        self._left_robots.append(robot)
        self._left_cameras += [(robot, camera) for camera in cameras]
        return True

    def _drop_camera(self, robot: str, cameras: OrderedDict[str, int], now_ns: int) -> bool:
        camera, at_ns = next(iter(cameras.items()))
        if at_ns > now_ns - ABSENT_NS:
            return False
        del cameras[camera]
        self._left_cameras.append((robot, camera))
        return True


class LeftOutCounts:
    """Counts what was left out by robot and reason.

    Anybody can invent names: of more than `most_robots`, the one counted longest ago is counted without its name, as
    are those that are forgotten. by_reason: counts of all robots.
    """

    def __init__(self, most_robots: int = MAX_ROBOTS) -> None:
        self.by_reason: Counter[str] = Counter()
        self._most_robots = most_robots
        self._robots: OrderedDict[str, Counter[str]] = OrderedDict()  # those counted longest ago are first
        self._nameless: Counter[str] = Counter()
        self._is_full = False

    def add(self, robot: str, reason: str, count: int = 1) -> bool:
        """Count; return whether it is the first of its kind, as far as one knows: not of ever more new names."""
        self.by_reason[reason] += count
        is_new = robot not in self._robots
        if is_new and len(self._robots) >= self._most_robots:
            self._is_full = True
            self.forget([next(iter(self._robots))])
        counts = self._robots.setdefault(robot, Counter())
        self._robots.move_to_end(robot)
        counts[reason] += count
        return counts[reason] == count and not (is_new and self._is_full)

    def forget(self, robots: Iterable[str]) -> None:
        """Count what was left out of robots without their names."""
        for robot in robots:
            self._nameless.update(self._robots.pop(robot, {}))

    def items(self) -> list[tuple[tuple[str, str], int]]:
        """Return counts by robot and reason, "" standing for robots without a name."""
        named = [((robot, reason), count) for robot, some in self._robots.items() for reason, count in some.items()]
        return [*named, *((("", reason), count) for reason, count in self._nameless.items())]


class NameNumbers(Generic[T]):
    """Numbers of names from 0 on; those of forgotten names are given to others. blank: stands for no name.

    names: by number, `blank` for a number that is free.
    """

    def __init__(self, blank: T) -> None:
        self.names: list[T] = []
        self._blank = blank
        self._numbers: dict[T, int] = {}
        self._free: list[int] = []

    def number(self, name: T) -> int:
        """Return the number of a name; a new name gets one."""
        number = self._numbers.get(name)
        if number is None:
            if self._free:
                number = self._free.pop()
            else:
                number = len(self.names)
                self.names.append(self._blank)
            self.names[number], self._numbers[name] = name, number
        return number

    def find(self, name: T) -> int | None:
        """Return the number of a name, None for one that has none."""
        return self._numbers.get(name)

    def items(self) -> ItemsView[T, int]:
        """Return names with their numbers."""
        return self._numbers.items()

    def forget(self, names: Iterable[T]) -> list[int]:
        """Forget names; return the numbers that they had, which are free now."""
        freed = [self._numbers.pop(name) for name in names if name in self._numbers]
        for number in freed:
            self.names[number] = self._blank
        self._free += freed
        return freed

    def restore(self, names: Sequence[T]) -> None:
        """Go on with `names` as they were, where none is known."""
        self.names = list(names)
        self._numbers = {name: number for number, name in enumerate(names) if name != self._blank}
        self._free = [number for number, name in enumerate(names) if name == self._blank]
