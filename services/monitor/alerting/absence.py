"""Absent robots and cameras, reported only once their absence is confirmed. Pure."""

from dataclasses import dataclass
from typing import Generic, TypeVar

from schemas.keys import CameraKey
from services.monitor.health import GAP_S, Heartbeat
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import Inventory
from services.monitor.inventory.sighting import NS

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

    def since_ns(self, who: K) -> int | None:
        """Return since when a member is absent; None while that is not confirmed."""
        return self._sure.get(who)


class Absentees:
    """The confirmed absences among an inventory's robots and cameras. now_s: steady clock; now_ns: epoch."""

    def __init__(self, inventory: Inventory, hearing: Heartbeat) -> None:
        self._inventory = inventory
        self._hearing = hearing
        self._robots = Absence[str]()
        self._gone = Absence[CameraKey]()
        self._mute = Absence[CameraKey]()
        self._came: set[CameraKey] = set()

    def clear(self) -> None:
        """Start over: members that were absent may be present by now."""
        for each in (self._robots, self._gone, self._mute):
            each.clear()

    def look_at_robot(self, robot: str, now_ns: int, now_s: float) -> tuple[bool | None, int]:
        """Return whether a robot's gateway is online (None if unknown), and since when it is offline.

        Of a robot that was forgotten it is not known, nor asked.
        """
        if self._hearing.deaf or self._inventory.is_forgotten(robot):
            return None, now_ns
        if self._inventory.is_alive(robot):
            self._robots.drop(robot)
            return True, now_ns
        if self._hearing.settled:
            self._robots.note(robot, now_ns, now_s + GAP_S)
        since_ns = self._robots.since_ns(robot)
        return (None, now_ns) if since_ns is None else (False, since_ns)

    def look_at_camera(self, camera: CameraView, now_ns: int, now_s: float, *, told: bool, ceased: bool) -> None:
        """Note whether a camera is live. told: it is new, came or went. ceased: it was live until now.

        One that came, or that was not heard of before, has as long until its lists are missed as one that had some.
        """
        key, stale_ns = camera.key, self._inventory.limits.stale_ns
        online, speaks = self._inventory.online(key), self._inventory.speaks(camera, now_ns)
        if online and (told or speaks):
            self._came.add(key)
            self._gone.drop(key)
        if speaks:
            self._mute.drop(key)
        if not self._hearing.settled or speaks:
            return
        if not online and key in self._came:
            self._gone.note(key, now_ns, now_s + GAP_S)
        else:
            self._await_list(key, now_ns - stale_ns if ceased else now_ns, now_ns, now_s)

    def _await_list(self, key: CameraKey, from_ns: int, now_ns: int, now_s: float) -> None:
        """Have a camera be silent if no list comes until it is stale. Before its lease a lost link is not noticed."""
        stale_s = self._inventory.limits.stale_ns / NS
        due_s = now_s + (from_ns - now_ns) / NS + max(stale_s, self._hearing.lease_s) + GAP_S
        self._mute.note(key, from_ns + self._inventory.limits.stale_ns, due_s)

    def silent_ns(self, key: CameraKey) -> int | None:
        """Return since when a camera is silent; None while that is not confirmed."""
        since_ns = [since for each in (self._gone, self._mute) if (since := each.since_ns(key)) is not None]
        return min(since_ns, default=None)

    def ripen(self, now_ns: int, now_s: float) -> tuple[list[str], list[CameraView]]:
        """Return the robots and cameras whose absence was confirmed since the last call."""
        if not self._hearing.settled:
            return [], []
        heard_s = self._hearing.heard_s
        ripe = dict.fromkeys([*self._gone.ripen(heard_s), *self._mute.ripen(heard_s)])
        cameras = [self._inventory.camera(key) for key in ripe]
        silent = [camera for camera in cameras if camera is not None and not self._goes_on(camera, now_ns, now_s)]
        return self._robots.ripen(heard_s), silent

    def _goes_on(self, camera: CameraView, now_ns: int, now_s: float) -> bool:
        """Whether a camera that is there had a list lately after all; wait for the next one then."""
        if not self._inventory.online(camera.key) or camera.last_ns < now_ns - self._inventory.limits.stale_ns:
            return False
        self._mute.drop(camera.key)
        self._await_list(camera.key, camera.last_ns, now_ns, now_s)
        return True
