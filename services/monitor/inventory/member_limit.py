"""The limit of members, and which absent ones make room for new ones. Pure."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from collections.abc import Set as AbstractSet
from itertools import chain, islice
from typing import Final

from schemas.keys import MOST_CAMERAS, CameraKey

MAX_MEMBERS: Final = 20_000
"""Maximum number of robots, cameras, or workers, followed; a flood of names cannot fill memory."""

PART: Final = 32
"""The part of a full room that is emptied at once: making room for each new name on its own would be slow."""

CLAIMED_PART: Final = 4
"""The part of the room that cameras may have that never announced themselves."""

SETTLED_NS: Final = 15_000_000_000
"""Time after the start in which cameras announce themselves: until then nobody's silence counts."""

SHOWN_NS: Final = 60_000_000_000
"""Time for which it is shown that there was no room, or that room was made."""

Held = Callable[[], AbstractSet[tuple[str, str]]]
"""Returns the robots, and cameras (else ''), that have to stay although they are absent: they have open alerts."""


class InventoryFullError(Exception):
    """The limit of robots, cameras or workers is reached, and none of them is absent."""


def check_room(members: Collection[object], name: object) -> None:
    """Raise InventoryFullError if there are MAX_MEMBERS and `name` is none of them."""
    if name not in members and len(members) >= MAX_MEMBERS:
        raise InventoryFullError(f"{len(members)} are followed already, {name} is left out")


def first_leaving(heard: Iterable[str], stays: Callable[[str], bool]) -> list[str]:
    """Return robots that leave so that others fit. heard: by when they were heard, the one longest ago first.

    Raises:
        InventoryFullError: all of them stay.
    """
    found = list(islice((each for each in heard if not stays(each)), max(1, MAX_MEMBERS // PART)))
    if not found:
        raise InventoryFullError(f"{MAX_MEMBERS:,} robots are followed, the most there may be, and all are present")
    return found


class MemberLimit:
    """Which cameras are present, and which absent ones leave first when there are too many.

    First those leave that never announced themselves, as names in messages cost their sender nothing; then the absent
    ones. Of each the one heard of longest ago goes first. One that is present or held never leaves.
    """

    def __init__(self) -> None:
        self.held: Held = frozenset
        self.present: set[CameraKey] = set()
        self._claimed: dict[CameraKey, None] = {}
        self._absent: dict[CameraKey, None] = {}
        self._per_robot = Counter[str]()
        self.made = 0
        self._new_notes: set[str] = set()
        self._notes: dict[str, int] = {}
        self._first_ns: int | None = None
        self.settled = False

    def __len__(self) -> int:
        return len(self.present) + len(self._claimed) + len(self._absent)

    def leaving(self, key: CameraKey, *, announced: bool) -> list[CameraKey]:
        """Return the cameras that have to leave before a new one can be taken; mostly none.

        Raises:
            InventoryFullError: there is no room, and all others are present or held.
        """
        if self._per_robot[key.robot] >= MOST_CAMERAS:
            of_robot = (each for each in self._in_order() if each.robot == key.robot)
            full = f"{key.robot} has {MOST_CAMERAS} cameras, the most that one robot may have"
            return self._first(of_robot, MOST_CAMERAS, key, full)
        if not announced and self.settled and len(self._claimed) >= _most_claimed():
            full = f"{len(self._claimed):,} cameras are known from messages alone, the most there may be"
            return self._first(iter(self._claimed), MAX_MEMBERS, key, full)
        if len(self) >= MAX_MEMBERS:
            full = f"{MAX_MEMBERS:,} cameras are followed, the most there may be"
            return self._first(self._in_order(), MAX_MEMBERS, key, full)
        return []

    def leaving_when_settled(self) -> list[CameraKey]:
        """Return the cameras that leave as they did not announce themselves in the time that they had for it."""
        most = _most_claimed()
        if not self.settled or len(self._claimed) <= most:
            return []
        full = f"{len(self._claimed):,} cameras are known from messages alone, of at most {most:,}"
        self._new_notes.add(f"{full}: those absent longest make room for new names")
        return self._free(self._claimed, len(self._claimed) - most)

    def leaving_for_classes(self) -> list[CameraKey]:
        """Return the absent cameras that leave as the classes of all take too much memory: a quarter of all."""
        self._new_notes.add("the classes of all cameras take the memory that they may have: further ones are left out")
        return self._free(self._in_order(), max(1, len(self) // 4))

    def _free(self, absent: Iterable[CameraKey], most: int) -> list[CameraKey]:
        """Return the first absent cameras that need not stay, and count them as having made room."""
        held = self.held()
        found = list(islice((each for each in absent if (each.robot, each.camera) not in held), most))
        self.made += len(found)
        return found

    def _first(self, absent: Iterator[CameraKey], most: int, key: CameraKey, full: str) -> list[CameraKey]:
        found = self._free(absent, max(1, most // PART))
        if not found:
            self._new_notes.add(f"{full}, and all are present or have open alerts: further ones are left out")
            raise InventoryFullError(f"{full}, {key} is left out")
        self._new_notes.add(f"{full}: those absent longest make room for new names")
        return found

    def _in_order(self) -> Iterator[CameraKey]:
        return chain(self._claimed, self._absent)

    def add(self, key: CameraKey) -> None:
        """Add a camera of which something was heard, without an announcement of its own so far."""
        self._claimed[key] = None
        self._per_robot[key.robot] += 1

    def remove(self, key: CameraKey) -> None:
        """Remove a camera."""
        for names in (self._claimed, self._absent):
            names.pop(key, None)
        self.present.discard(key)
        self._per_robot[key.robot] -= 1
        if not self._per_robot[key.robot]:
            del self._per_robot[key.robot]

    def of(self, robot: str) -> int:
        """Return the number of cameras of a robot."""
        return self._per_robot[robot]

    def note(self, key: CameraKey, *, alive: bool) -> None:
        """Note that a known camera announced itself, or went."""
        self._claimed.pop(key, None)
        self._absent.pop(key, None)
        if alive:
            self.present.add(key)
        else:
            self.present.discard(key)
            self._absent[key] = None

    def heard(self, key: CameraKey) -> None:
        """Note a message of a known camera."""
        if key not in self.present:
            names = self._claimed if key in self._claimed else self._absent
            del names[key]
            names[key] = None

    def tick(self, now_ns: int) -> None:
        """Advance time."""
        if self._first_ns is None:
            self._first_ns = now_ns
        self.settled = self.settled or now_ns - self._first_ns >= SETTLED_NS
        self._notes = {note: at_ns for note, at_ns in self._notes.items() if 0 <= now_ns - at_ns < SHOWN_NS}
        self._notes |= dict.fromkeys(islice(self._new_notes, PART), now_ns)
        self._new_notes.clear()

    def problems(self) -> list[str]:
        """Return lines about the lack of room in the last minute."""
        return sorted(self._notes)[:3]


def _most_claimed() -> int:
    return max(1, MAX_MEMBERS // CLAIMED_PART)
