"""Where objects and robots were seen last in the map. Pure: time is an argument."""

import math
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from schemas.distances import Distances, ObjectDistance
from services.monitor.inventory.member_limit import MAX_MEMBERS
from services.monitor.liveness import is_pose_live
from services.monitor.map.pose import MAP, DrawnRobot, Pose, pose_of

MOST: Final = 2_000
"""Maximum number of places kept, those seen last; as many tracked objects are known by their track."""

FORGET_NS: Final = 1_800 * 1_000_000_000
"""Age from which objects are no longer shown."""

RENEW_NS: Final = 2 * 1_000_000_000
"""Period at which a robot's pose is estimated."""

SAME_M: Final = 0.6
"""Objects of a class seen closer together, at different times or by different robots, are one."""


@dataclass(frozen=True, slots=True)
class MapObject:
    """An object where it was last seen: x, y in metres in the map, seen_ns since the epoch on this machine's clock."""

    name: str
    x: float
    y: float
    robot: str
    camera: str
    seen_ns: int


_CellKey = tuple[str, str, str, int, int]
"""Robot, camera, class and cell."""


class SightingMap:
    """The last places of all objects of the fleet. A tracked object is in one place, its last.

    Of what a camera sees in a cell of SAME_M the newest image counts: an object that is followed anew is no second one.

    poses: where robots were, by two objects that were seen at once, which tell how the robot stands to the map, or by
    what others say.
    """

    def __init__(self) -> None:
        self.poses: dict[str, Pose] = {}
        self._sought_ns: dict[str, int] = {}
        self._marks: OrderedDict[_CellKey, dict[int | None, MapObject]] = OrderedDict()
        self._tracks: OrderedDict[tuple[str, str, int], _CellKey] = OrderedDict()
        self._ticked_ns = 0

    def tick(self, now_ns: int) -> None:
        """Advance time; if the clock was set back, everything keeps its age."""
        back_ns, self._ticked_ns = self._ticked_ns - now_ns, now_ns
        if back_ns <= 0:
            return
        self._sought_ns.clear()
        for name, pose in self.poses.items():
            if pose.at_ns > now_ns:
                self.poses[name] = replace(pose, at_ns=pose.at_ns - back_ns)
        for here in self._marks.values():
            for track, mark in here.items():
                if mark.seen_ns > now_ns:
                    here[track] = replace(mark, seen_ns=mark.seen_ns - back_ns)

    def take(self, distances: Distances, seen_ns: int) -> None:
        """Take the places of one image's objects; those without a place in the map are left out."""
        of = distances.header
        if len(distances.objects) > 1 and seen_ns - self._sought_ns.get(of.robot, 0) >= RENEW_NS:
            self._sought_ns[of.robot] = seen_ns
            pose = pose_of(distances, seen_ns)
            if pose is not None:
                self.poses[of.robot] = pose
        for each in distances.objects:
            at = _in_map(each)
            if at is not None:
                self._put(each.track, MapObject(each.name, at[0], at[1], of.robot, of.camera, seen_ns))
        while len(self._marks) > MOST:
            self._marks.popitem(last=False)

    def _put(self, track: int | None, mark: MapObject) -> None:
        place = (mark.robot, mark.camera, mark.name, *_cell((mark.x, mark.y)))
        if track is not None:
            self._move(track, mark, place)
        here = self._marks.setdefault(place, {})
        if any(other.seen_ns != mark.seen_ns for other in here.values()):
            here.clear()
        here[track] = mark
        self._marks.move_to_end(place)

    def _move(self, track: int, mark: MapObject, place: _CellKey) -> None:
        """Take a tracked object from where it was before."""
        of = (mark.robot, mark.camera, track)
        before = self._tracks.pop(of, place)
        self._tracks[of] = place
        if before != place and (there := self._marks.get(before)) is not None:
            there.pop(track, None)
            if not there:
                del self._marks[before]
        if len(self._tracks) > MOST:
            self._tracks.popitem(last=False)

    def stand(self, poses: Mapping[str, Pose]) -> None:
        """Take robots' poses, current or old, from another source; newer ones stay."""
        for name, pose in poses.items():
            known = self.poses.get(name)
            if known is None or known.at_ns < pose.at_ns:
                self.poses[name] = pose

    def forget(self, robot: str) -> None:
        """Forget a robot's pose."""
        self.poses.pop(robot, None)
        self._sought_ns.pop(robot, None)

    def marks(self, now_ns: int, *, robot: str = "") -> list[MapObject]:
        """Return the objects' places, newest first; of one robot if it is named.

        Robots are taken to share one map: sightings by several at about the same place are one object.
        """
        since_ns = now_ns - FORGET_NS
        every = (mark for here in self._marks.values() for mark in here.values())
        newest = sorted(every, key=lambda mark: mark.seen_ns, reverse=True)
        wanted = (mark for mark in newest if mark.seen_ns >= since_ns and robot in ("", mark.robot))
        return list(_apart(wanted))


def _in_map(each: ObjectDistance) -> tuple[float, float] | None:
    if each.measured is None:
        return None
    at = next((place.at for place in each.measured.places if place.frame_id.removeprefix("/") == MAP), None)
    return None if at is None else at[:2]


def _cell(at: tuple[float, float]) -> tuple[int, int]:
    return math.floor(at[0] / SAME_M), math.floor(at[1] / SAME_M)


def _apart(marks: Iterable[MapObject]) -> Iterator[MapObject]:
    """Yield the marks that are no object that was there before; marks of one image are never one object."""
    cells: dict[tuple[str, int, int], list[MapObject]] = {}
    for mark in marks:
        column, row = _cell((mark.x, mark.y))
        near = (
            other
            for across in (-1, 0, 1)
            for along in (-1, 0, 1)
            for other in cells.get((mark.name, column + across, row + along), ())
        )
        if not any(_same(mark, other) for other in near):
            cells.setdefault((mark.name, column, row), []).append(mark)
            yield mark


def _same(mark: MapObject, other: MapObject) -> bool:
    """Whether two marks of a class are one object: near, and not two objects of one image."""
    of_one_image = (mark.robot, mark.camera, mark.seen_ns) == (other.robot, other.camera, other.seen_ns)
    return not of_one_image and math.hypot(mark.x - other.x, mark.y - other.y) < SAME_M


MAX_POSES: Final = MAX_MEMBERS
"""Maximum number of poses kept, the newest ones: as many as robots are followed."""


@dataclass(frozen=True, slots=True)
class _Known:
    pose: Pose
    known_ns: int


class LastPoses:
    """The newest pose of every robot; kept, once out of date, for as long as objects are.

    is_forgotten: whether a robot was forgotten, whatever the age of its pose.
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
        return [
            DrawnRobot(name, pose, live=is_pose_live(pose.at_ns, now_ns, online=name in online)) for name, pose in poses
        ]
