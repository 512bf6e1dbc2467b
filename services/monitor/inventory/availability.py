"""Follows which cameras become available or silent, and confirms absences. Pure.

The states are defined in `services.monitor.liveness`.
"""

import heapq
from collections.abc import Callable, Collection, Iterable, Iterator
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import count
from typing import Final, Generic, TypeVar

from schemas.keys import CameraKey
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import MAX_NS, Inventory
from services.monitor.inventory.sighting import NS
from services.monitor.liveness import NETWORK_GRACE_S, Heartbeat, is_recent

AT_ONCE: Final = 500
PARTS: Final = 5
"""Limits the checks per call to a number, or this part of all cameras, so that no call takes long."""

IsAvailable = Callable[[CameraView, int], bool]
"""Whether a camera is available at a time; it stays so until `stale_ns` after its newest list, unless notified."""


class AvailabilityTracker:
    """Tracks the available cameras of an inventory. One is checked again only when it could have fallen silent.

    available: whether a new one counts as available before it was checked.
    """

    def __init__(self, inventory: Inventory, rule: IsAvailable, *, available: bool) -> None:
        self._inventory = inventory
        self._rule = rule
        self._new_available = available
        self._known = 0
        self._silent: set[CameraView] = set()
        self._deadlines: list[tuple[int, int, CameraView]] = []
        self._waiting: set[CameraView] = set()
        self._left: list[CameraView] = []
        self._numbers = count()
        self._now_ns = 0
        inventory.on_leave(self._leave)

    def advance(self, now_ns: int, told: Iterable[CameraView] = ()) -> list[CameraView]:
        """Return the cameras that became available or silent by `now_ns`. told: cameras to check in any case."""
        self._meet(self._inventory.cameras_after(self._known), now_ns)
        looked_at = {*told, *self._due(now_ns)} - self._silent
        began = [view for view in self._silent if self._rule(view, now_ns)]
        ceased = [view for view in looked_at if not self._rule(view, now_ns)]
        self._silent.difference_update(began)
        self._silent.update(ceased)
        for view in (*began, *looked_at.difference(ceased)):
            newest_ns = min(view.last_ns, now_ns)  # after a clock was set back, earlier arrivals are in the future
            self._wait(view, max(now_ns, newest_ns + self._inventory.limits.stale_ns) + 1)
        left, self._left = self._left, []
        return [*began, *ceased, *left]

    def _leave(self, left: Collection[CameraView]) -> None:
        """Forget cameras; those that were available are returned once more."""
        gone = set(left)
        self._left += gone & self._waiting
        self._silent -= gone
        self._waiting -= gone
        self._deadlines = [each for each in self._deadlines if each[2] not in gone]
        heapq.heapify(self._deadlines)

    def _meet(self, new: Collection[CameraView], now_ns: int) -> None:
        self._known = max([self._known, *(view.number for view in new)])
        if not self._new_available:
            self._silent.update(new)
            return
        for view in new:
            self._wait(view, now_ns)

    def _due(self, now_ns: int) -> Iterator[CameraView]:
        """Take out the due cameras, in batches; all of them if the clock was set back."""
        was_set_back, self._now_ns = now_ns < self._now_ns, now_ns
        until_ns = MAX_NS if was_set_back else now_ns
        most = len(self._deadlines) if was_set_back else max(AT_ONCE, len(self._deadlines) // PARTS)
        while most and self._deadlines and self._deadlines[0][0] <= until_ns:
            most -= 1
            view = heapq.heappop(self._deadlines)[2]
            self._waiting.discard(view)
            yield view

    def _wait(self, view: CameraView, until_ns: int) -> None:
        if view not in self._waiting:
            self._waiting.add(view)
            heapq.heappush(self._deadlines, (until_ns, next(self._numbers), view))


K = TypeVar("K")


@dataclass(frozen=True, slots=True)
class _Absent:
    since_ns: int
    due_s: float


class Absence(Generic[K]):
    """Absent members. An absence is confirmed when it is due and the monitor has heard its own heartbeat since."""

    def __init__(self) -> None:
        self._waiting: dict[K, _Absent] = {}
        self._sure: dict[K, int] = {}

    def note(self, who: K, since_ns: int, due_s: float) -> None:
        """Note an absent member, unless it is noted already. since_ns: epoch. due_s: of the steady clock."""
        if who not in self._sure:
            self._waiting.setdefault(who, _Absent(since_ns, due_s))

    def drop(self, who: K) -> None:
        """Forget a member that is present again."""
        self._waiting.pop(who, None)
        self._sure.pop(who, None)

    def clear(self) -> None:
        """Forget all members."""
        self._waiting.clear()
        self._sure.clear()

    def ripen(self, heard_s: float) -> list[K]:
        """Return the absences confirmed since the last call. heard_s: when the monitor last heard its own heartbeat."""
        ripe = [who for who, absent in self._waiting.items() if absent.due_s <= heard_s]
        for who in ripe:
            self._sure[who] = self._waiting.pop(who).since_ns
        return ripe

    def keep(self, known: Callable[[K], bool]) -> None:
        """Forget all members that are not known."""
        self._waiting = {who: absent for who, absent in self._waiting.items() if known(who)}
        self._sure = {who: since_ns for who, since_ns in self._sure.items() if known(who)}

    def since_ns(self, who: K) -> int | None:
        """Return since when a member is absent; None while that is not confirmed."""
        return self._sure.get(who)


class AbsenceTracker:
    """The confirmed absences among an inventory's robots and cameras. now_s: steady clock; now_ns: epoch."""

    def __init__(self, inventory: Inventory, heartbeat: Heartbeat) -> None:
        self._inventory = inventory
        self._heartbeat = heartbeat
        self._robots = Absence[str]()
        self._gone = Absence[CameraKey]()
        self._mute = Absence[CameraKey]()
        self._came: set[CameraKey] = set()
        inventory.on_leave(self._leave)

    def _leave(self, left: Collection[CameraView]) -> None:
        for view in left:
            self._gone.drop(view.key)
            self._mute.drop(view.key)
            self._came.discard(view.key)

    def keep_robots(self, known: AbstractSet[str]) -> None:
        """Forget all other robots."""
        self._robots.keep(known.__contains__)

    def clear(self) -> None:
        """Start over: members that were absent may be present by now."""
        for each in (self._robots, self._gone, self._mute):
            each.clear()

    def look_at_robot(self, robot: str, now_ns: int, now_s: float) -> tuple[bool | None, int]:
        """Return whether a robot's gateway is online (None if unknown), and since when it is offline.

        Of a robot that was forgotten it is not known, nor asked.
        """
        if self._heartbeat.deaf or self._inventory.is_forgotten(robot):
            return None, now_ns
        if self._inventory.is_alive(robot):
            self._robots.drop(robot)
            return True, now_ns
        if self._heartbeat.settled:
            self._robots.note(robot, now_ns, now_s + NETWORK_GRACE_S)
        since_ns = self._robots.since_ns(robot)
        return (None, now_ns) if since_ns is None else (False, since_ns)

    def look_at_camera(self, camera: CameraView, now_ns: int, now_s: float, *, told: bool, ceased: bool) -> None:
        """Note whether a camera is available. told: it is new, came or went. ceased: it was available until now.

        One that came, or that was not heard of before, has as long until its lists are missed as one that had some.
        """
        key, stale_ns = camera.key, self._inventory.limits.stale_ns
        online, available = self._inventory.online(key), self._inventory.is_available(camera, now_ns)
        if online and (told or available):
            self._came.add(key)
            self._gone.drop(key)
        if available:
            self._mute.drop(key)
        if not self._heartbeat.settled or available:
            return
        if not online and key in self._came:
            self._gone.note(key, now_ns, now_s + NETWORK_GRACE_S)
        else:
            self._await_list(key, now_ns - stale_ns if ceased else now_ns, now_ns, now_s)

    def _await_list(self, key: CameraKey, from_ns: int, now_ns: int, now_s: float) -> None:
        """Have a camera be silent if no list comes until it is stale. Before its lease a lost link is not noticed."""
        stale_s = self._inventory.limits.stale_ns / NS
        due_s = now_s + (from_ns - now_ns) / NS + max(stale_s, self._heartbeat.lease_s) + NETWORK_GRACE_S
        self._mute.note(key, from_ns + self._inventory.limits.stale_ns, due_s)

    def silent_ns(self, key: CameraKey) -> int | None:
        """Return since when a camera is silent; None while that is not confirmed."""
        since_ns = [since for each in (self._gone, self._mute) if (since := each.since_ns(key)) is not None]
        return min(since_ns, default=None)

    def ripen(self, now_ns: int, now_s: float) -> tuple[list[str], list[CameraView]]:
        """Return the robots and cameras whose absence was confirmed since the last call."""
        if not self._heartbeat.settled:
            return [], []
        heard_s = self._heartbeat.heard_s
        ripe = dict.fromkeys([*self._gone.ripen(heard_s), *self._mute.ripen(heard_s)])
        cameras = [self._inventory.camera(key) for key in ripe]
        silent = [camera for camera in cameras if camera is not None and not self._goes_on(camera, now_ns, now_s)]
        return self._robots.ripen(heard_s), silent

    def _goes_on(self, camera: CameraView, now_ns: int, now_s: float) -> bool:
        """Whether a camera that is there had a list lately after all; wait for the next one then."""
        if not self._inventory.online(camera.key) or not is_recent(
            camera.last_ns, now_ns, self._inventory.limits.stale_ns
        ):
            return False
        self._mute.drop(camera.key)
        self._await_list(camera.key, camera.last_ns, now_ns, now_s)
        return True
