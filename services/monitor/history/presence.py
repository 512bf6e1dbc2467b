"""Presence of robots' gateways, of available cameras and of monitors. Pure."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Final, Self

from services.monitor.history.interval_buffer import IntervalBuffer, StoredInterval
from services.monitor.inventory.availability import AvailabilityTracker
from services.monitor.inventory.inventory import Inventory
from services.monitor.inventory.sighting import NS
from services.monitor.liveness import SETTLE_NS
from services.monitor.map.last_seen import SightingMap
from services.monitor.map.pose import Pose

PresenceKey = tuple[str, str]
"""A robot and its camera; the latter is empty for the robot itself."""

MONITOR: Final[PresenceKey] = ("", "")
"""The place of a monitor while it raises alerts; silence is known only during such an interval."""

RESTORED_NS: Final = 86_400 * NS
"""Maximum age of a presence, or sighting, that a starting monitor restores and then may miss."""


class Presence(StoredInterval, frozen=True, gc=False):
    """An interval in which a gateway was online, a camera was available, or a monitor raised alerts (neither named).

    heard_ns: when the last class list of a camera came before it was found silent.
    """

    robot: str = ""
    camera: str = ""
    heard_ns: int | None = None

    @property
    def place(self) -> PresenceKey:
        """The robot and camera of the interval."""
        return (self.robot, self.camera)

    def is_as(self, _: Self) -> bool:
        """Whether an interval a short while ago continues; a monitor's own never does."""
        return self.place != MONITOR


def presence_of(place: PresenceKey, since_ns: int) -> Presence:
    """Return the open interval of a present member."""
    return Presence(since_ns=since_ns, until_ns=since_ns, open=True, robot=place[0], camera=place[1])


class Attendance:
    """Enters presence in a buffer, from arrivals and departures only; members that stay cost nothing."""

    def __init__(self, inventory: Inventory, buffer: IntervalBuffer) -> None:
        self._inventory = inventory
        self._buffer = buffer
        self._news = inventory.follow()
        self._availability = AvailabilityTracker(inventory, inventory.is_available, available=False)
        self._before: dict[PresenceKey, int] = {}
        self._settled_ns = 0

    def resume(self, stored: Iterable[Presence], now_ns: int) -> None:
        """Take the members present when a monitor stopped a short while ago: one back at once was never absent."""
        self._before = {each.place: each.since_ns for each in stored if each.place != MONITOR}
        self._settled_ns = now_ns + SETTLE_NS

    def lead(self, now_ns: int) -> None:
        """Note that from now on this monitor raises alerts."""
        self._buffer.begin(presence_of(MONITOR, now_ns))

    def follow(self) -> None:
        """Note that another monitor raises alerts."""
        self._buffer.drop(Presence, MONITOR)

    def note(self, now_ns: int) -> Iterator[None]:
        """Enter arrivals and departures, and yield after each: all may come at once."""
        if now_ns > self._settled_ns:
            self._before.clear()
        robots, cameras = self._news.robots, self._news.cameras
        self._news.robots, self._news.cameras = set(), set()
        told = [camera for key in cameras if (camera := self._inventory.camera(key)) is not None]
        for robot in robots:
            self._note((robot, ""), now_ns, there=self._inventory.is_alive(robot))
            yield
        for camera in self._availability.advance(now_ns, told):
            key = camera.key
            available = self._inventory.is_available(camera, now_ns)
            self._note((key.robot, key.camera), now_ns, there=available, heard_ns=camera.last_ns)
            yield

    def note_gone(self, robot: str, now_ns: int) -> None:
        """Enter a robot's departure, though it was not looked at since."""
        self._note((robot, ""), now_ns, there=False)

    def _note(self, place: PresenceKey, now_ns: int, *, there: bool, heard_ns: int | None = None) -> None:
        was_there = self._buffer.opened(Presence, place) is not None
        if there and not was_there:
            self._buffer.begin(presence_of(place, self._before.get(place, now_ns)))
        elif was_there and not there:
            self._buffer.end(Presence, place, now_ns, heard_ns=heard_ns)


WRITE_S: Final = 30.0
"""How often poses are written: robots move all the time."""


class KnownPoses:
    """The poses of a map, and those that are not written yet."""

    def __init__(self, places: SightingMap) -> None:
        self._places = places
        self._written: dict[str, Pose] = {}

    def restore(self, poses: Mapping[str, Pose]) -> None:
        """Take stored poses."""
        self._written.update(poses)
        self._places.stand(poses)

    def pending(self) -> Iterator[tuple[str, Pose]]:
        """Yield the robots with unwritten poses that a database accepts."""
        for name, pose in list(self._places.poses.items()):
            if self._written.get(name) is not pose and all(map(math.isfinite, (pose.x, pose.y, pose.yaw))):
                yield name, pose

    def written(self, poses: Mapping[str, Pose]) -> None:
        """Mark poses as written."""
        self._written.update(poses)
        for robot in self._written.keys() - self._places.poses.keys():
            del self._written[robot]
