"""The inventory: the objects in view of every camera of the fleet, and since when. Pure."""

from bisect import bisect_left, bisect_right, insort
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from itertools import chain, takewhile
from operator import attrgetter
from typing import Final
from weakref import WeakMethod

import msgspec

from schemas.detections import ClassList
from schemas.distances import Distances
from schemas.keys import MOST_CAMERAS, CameraKey, camera_key
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.member_limit import MAX_MEMBERS, MemberLimit, check_room
from services.monitor.inventory.sighting import NS, Change, Sighting
from services.monitor.inventory.view import MAX_CLASS_BYTES, ClassRoom
from services.monitor.liveness import LOST_S, STALE_S

MAX_NS: Final = 2**63 - 1


@dataclass(frozen=True, slots=True)
class TrustLimits:
    """Debouncing and time limits for trusting cameras, in nanoseconds.

    stale_ns: how old a camera's newest list may be for its view to be available, and for its model to stay primary.
    lost_ns: how long nothing may come before it is not known any more what is in view.
    """

    debounce: Debounce = field(default_factory=Debounce)
    stale_ns: int = round(STALE_S * NS)
    lost_ns: int = round(LOST_S * NS)


class Entry(msgspec.Struct, frozen=True, gc=False):
    """A sighting, and whether its camera is available, so that it is current."""

    sighting: Sighting
    available: bool


@dataclass(slots=True)
class News:
    """The robots and cameras that are new, came or went. The follower empties it."""

    cameras: set[CameraKey] = field(default_factory=set)
    robots: set[str] = field(default_factory=set)

    def tell(self, robot: str, cameras: Iterable[CameraKey] = ()) -> None:
        """Note a robot and cameras of it; at most MAX_MEMBERS of either until they are taken."""
        if len(self.robots) < MAX_MEMBERS:
            self.robots.add(robot)
        self.cameras.update(cameras)


OnLeave = Callable[[Collection[CameraView]], None]
"""Is told of cameras that left the inventory to make room; nothing about them is to be remembered."""


class Inventory:
    """The objects in view of every camera. Times are nanoseconds since the epoch on this machine's clock.

    Every method that may add a member raises InventoryFullError when there are MAX_MEMBERS already and none is absent.

    room: which cameras make room for new ones. refused: class lists that came again, late or out of order, by camera.
    ignored_opinions, ignored_distances: others of which that is so; opinions also where their camera is not known.
    """

    def __init__(self, limits: TrustLimits | None = None) -> None:
        self.limits = limits or TrustLimits()
        self._vocabularies: dict[tuple[str, str], frozenset[str]] = {}
        self._cameras: dict[CameraKey, CameraView] = {}
        self._in_order: list[CameraKey] = []
        self._alive: set[str] = set()
        self.member_limit = MemberLimit()
        self.refused = Counter[CameraKey]()
        self.ignored_opinions = 0
        self.ignored_distances = 0
        self._class_room = ClassRoom()
        self._added = 0
        self._on_leave: list[WeakMethod[OnLeave]] = []
        self._gave_up: list[Change] = []
        self._disputed: set[CameraKey] = set()
        self._recalled: dict[str, int] = {}
        self._forgotten: set[str] = set()
        self._followers: list[News] = []
        self._ticked_ns = MAX_NS

    def follow(self) -> News:
        """Return an object that collects each new, arriving or departing robot and camera from now on."""
        self._followers.append(News(set(self._cameras), {*self._alive, *(key.robot for key in self._cameras)}))
        return self._followers[-1]

    def robot_presence(self, robot: str, *, alive: bool) -> None:
        """Note that a robot's gateway came or went."""
        if alive:
            check_room(self._alive, robot)
            self._remember(robot)
        (self._alive.add if alive else self._alive.discard)(robot)
        self._tell(robot)

    def forget(self, robot: str) -> None:
        """Leave an offline robot and its cameras out of every list until its gateway is back.

        Messages about it are processed as usual meanwhile.
        """
        if robot in self._alive:
            raise ValueError(f"the gateway of {robot} is there")
        self._tell(robot)
        self._forgotten.add(robot)
        self._recalled.pop(robot, None)
        self._in_order = [key for key in self._in_order if key.robot != robot]

    def is_forgotten(self, robot: str) -> bool:
        """Whether a robot was forgotten: see `forget`."""
        return robot in self._forgotten

    def _remember(self, robot: str) -> None:
        if robot in self._forgotten:
            self._forgotten.remove(robot)
            self._in_order = sorted([*self._in_order, *(key for key in self._cameras if key.robot == robot)])

    def _tell(self, robot: str) -> None:
        for news in self._followers:
            news.tell(robot, self.in_order(robot))

    def camera_presence(self, key: CameraKey, *, alive: bool) -> None:
        """Note that a camera came or went. One that went is remembered."""
        self._camera(key, announced=True)
        self.member_limit.note(key, alive=alive)
        for news in self._followers:
            news.cameras.add(key)

    def worker_reports(self, service: str, worker: str, classes: Iterable[str]) -> None:
        """Take the classes that a worker reports."""
        check_room(self._vocabularies, (service, worker))
        self._vocabularies[service, worker] = frozenset(classes)

    def forget_worker(self, service: str, worker: str) -> None:
        """Forget a worker's classes."""
        self._vocabularies.pop((service, worker), None)

    def see(self, seen: ClassList, at_ns: int) -> list[Change] | None:
        """Take a class list of a view at `at_ns`; return its changes, or None if it is a duplicate or late.

        Lists of one camera are to come in order, but a clock that was set back is lived with.
        """
        camera = self._camera(camera_key(seen.header.robot, seen.header.camera))
        of = self.limits
        changes = camera.see(seen, max(1, at_ns), of.debounce, of.stale_ns, of.lost_ns)
        if changes is None:
            self.refused[camera.key] += 1
        if len(camera.views) > 1:
            self._disputed.add(camera.key)
        self.member_limit.heard(camera.key)
        if self._gave_up and changes is not None:
            changes = [*self._take_given_up(), *changes]
        return changes

    def opine(self, seen: ClassList, at_ns: int) -> bool:
        """Take a second opinion of a view at `at_ns`; return False if it is a duplicate, late or on no camera.

        A camera has to be known for it: an opinion alone makes none.
        """
        camera = self._cameras.get(camera_key(seen.header.robot, seen.header.camera))
        if camera is None:
            self.ignored_opinions += 1
            return False
        self._disputed.add(camera.key)
        taken = camera.opine(seen, max(1, at_ns), self.limits.debounce, self.limits.stale_ns)
        self.ignored_opinions += not taken
        return taken

    def measure(self, distances: Distances, at_ns: int) -> bool:
        """Take distances; return False if they are a duplicate or late."""
        camera = self._camera(camera_key(distances.header.robot, distances.header.camera))
        self.member_limit.heard(camera.key)
        taken = camera.measure(distances, at_ns)
        self.ignored_distances += not taken
        return taken

    def tick(self, now_ns: int) -> list[Change]:
        """Advance time; return the sightings that became unknown."""
        if now_ns < self._ticked_ns:
            self.set_back(now_ns)
        self._ticked_ns = now_ns
        fresh_ns, since_ns = now_ns - self.limits.stale_ns, now_ns - self.limits.lost_ns
        self._disputed = {key for key in self._disputed if self._cameras[key].contested(fresh_ns)}
        self._recount_classes()
        self.member_limit.tick(now_ns)
        self._leave(self.member_limit.leaving_when_settled())
        silent = [each for each in self._cameras.values() if each.is_forsaken(since_ns)]
        return [*self._take_given_up(), *(change for camera in silent for change in camera.lose())]

    def _recount_classes(self) -> None:
        """Count the bytes of classes where there may be many; absent cameras leave where there are too many."""
        if self._class_room.bytes > MAX_CLASS_BYTES // 2:
            views = (chain(each.views.values(), each.opinions.values()) for each in self._cameras.values())
            self._class_room.recount(chain.from_iterable(views))
        if self._class_room.bytes > MAX_CLASS_BYTES * 3 // 4 and self.member_limit.settled:
            self._leave(self.member_limit.leaving_for_classes())

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        for each in self._cameras.values():
            each.set_back(now_ns)

    def restore(self, sightings: Iterable[Sighting]) -> None:
        """Take stored sightings, before anything else is taken; those over the limits are left out.

        The model of the newest one becomes primary, as after a silent one, and continues all of them.
        """
        newest_first = sorted(sightings, key=_newness, reverse=True)
        for sighting in newest_first:
            if sighting.key in self._cameras or (
                len(self._cameras) < MAX_MEMBERS and self.member_limit.of(sighting.key.robot) < MOST_CAMERAS
            ):
                self._camera(sighting.key, announced=True).restore(sighting)
        for sighting in sorted(newest_first, key=attrgetter("last_ns")):
            if sighting.key in self._cameras:
                self.member_limit.note(sighting.key, alive=False)

    def recall(self, there: Mapping[tuple[str, str], int], since_ns: int) -> None:
        """Take stored times until which robots, and cameras (else ''), were present, before anything else is taken.

        Followers are told of those that were there at `since_ns`, or later; cameras that were not are left out, and
        so are those over the limit, the longest ago first.
        """
        newest_first = sorted(there.items(), key=lambda each: -each[1])
        for (robot, camera), until_ns in newest_first:
            if not camera and len(self._recalled) < MAX_MEMBERS:
                self._recalled[robot] = until_ns
                for news in self._followers if until_ns >= since_ns else ():
                    news.tell(robot)
            elif camera and until_ns >= since_ns and len(self._cameras) < MAX_MEMBERS:
                self._camera(CameraKey(robot, camera), announced=True)
        for (robot, camera), _ in reversed(newest_first):
            if camera and (key := CameraKey(robot, camera)) in self._cameras:
                self.member_limit.note(key, alive=False)

    def recalled(self) -> Mapping[str, int]:
        """Return the robots that were present before this monitor started, and until when."""
        return self._recalled

    def is_alive(self, robot: str) -> bool:
        """Whether a robot's gateway is online."""
        return robot in self._alive

    def robots(self) -> AbstractSet[str]:
        """Return the robots whose gateways are online."""
        return self._alive

    def cameras(self) -> Collection[CameraView]:
        """Return every camera ever seen; read only."""
        return self._cameras.values()

    def cameras_after(self, number: int) -> list[CameraView]:
        """Return the cameras with a number above one, in order of it; see `CameraView`."""
        new = list(takewhile(lambda view: view.number > number, reversed(self._cameras.values())))
        return new[::-1]

    def on_leave(self, told: OnLeave) -> None:
        """Have a method told of cameras that leave to make room, for as long as its object is there."""
        self._on_leave = [each for each in self._on_leave if each() is not None]
        self._on_leave.append(WeakMethod(told))

    def in_order(self, robot: str = "") -> tuple[CameraKey, ...]:
        """Return every camera ever seen, or those of one robot, by robot and name; without forgotten robots."""
        return tuple(of_robot(self._in_order, robot) if robot else self._in_order)

    def camera(self, key: CameraKey) -> CameraView | None:
        """Return one camera; read only."""
        return self._cameras.get(key)

    def disputed(self) -> AbstractSet[CameraKey]:
        """Return the cameras on which several models ever reported, or a second opinion came recently."""
        return self._disputed

    def online(self, key: CameraKey) -> bool:
        """Whether a camera and its robot's gateway are online."""
        return key in self.member_limit.present and key.robot in self._alive

    def is_available(self, camera: CameraView, now_ns: int) -> bool:
        """Whether a camera's view is current."""
        return self.online(camera.key) and camera.is_available(now_ns - self.limits.stale_ns)

    def entries(self, now_ns: int, *, robot: str = "", camera: str = "", name: str = "") -> Iterator[Entry]:
        """Yield the sightings, ordered as by `in_order` and then class; of one robot or camera if it is named."""
        for key in [key for key in self.in_order(robot) if camera in ("", key.camera)]:
            yield from (entry for entry in self.entries_of(key, now_ns) if name in ("", entry.sighting.name))

    def entries_of(self, key: CameraKey, now_ns: int) -> list[Entry]:
        """Return a camera's sightings, by class; none of one that left to make room."""
        view = self._cameras.get(key)
        if view is None:
            return []
        available = self.is_available(view, now_ns)
        of = sorted(view.sightings(now_ns - self.limits.stale_ns), key=attrgetter("name"))
        return [Entry(sighting, available) for sighting in of]

    def _camera(self, key: CameraKey, *, announced: bool = False) -> CameraView:
        found = self._cameras.get(key)
        if found is None:
            self._leave(self.member_limit.leaving(key, announced=announced))
            self._added += 1
            found = self._cameras[key] = CameraView(key, self._vocabularies, self._added, self._class_room)
            self.member_limit.add(key)
            if key.robot not in self._forgotten:
                insort(self._in_order, key)
            for news in self._followers:
                news.tell(key.robot, [key])
        return found

    def _leave(self, keys: Collection[CameraKey]) -> None:
        """Forget cameras and their sightings."""
        if not keys:
            return
        left = [self._cameras.pop(key) for key in keys]
        for view in left:
            self.member_limit.remove(view.key)
            self.refused.pop(view.key, None)
            self._disputed.discard(view.key)
            if not view.lost:
                self._gave_up += view.lose()
        self._in_order = [key for key in self._in_order if key in self._cameras]
        for news in self._followers:
            news.cameras.difference_update(keys)
        for method in self._on_leave:
            if (told := method()) is not None:
                told(left)

    def _take_given_up(self) -> list[Change]:
        given_up, self._gave_up = self._gave_up, []
        return given_up


def of_robot(in_order: Sequence[CameraKey], robot: str) -> Sequence[CameraKey]:
    """Return a robot's cameras from an ordered sequence."""
    name_of = attrgetter("robot")
    return in_order[bisect_left(in_order, robot, key=name_of) : bisect_right(in_order, robot, key=name_of)]


def _newness(sighting: Sighting) -> tuple[bool, int, int]:
    return (sighting.count > 0, sighting.last_ns, sighting.since_ns)
