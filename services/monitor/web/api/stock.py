"""Some of what is in view, found without listing all of it."""

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from operator import attrgetter
from typing import Final

from schemas.keys import CameraKey
from services.monitor.inventory.inventory import Entry, Inventory
from services.monitor.turns import in_turns

PLACE: Final = attrgetter("robot", "camera")

Place = tuple[str, str, str]
"""Robot, camera and class."""


@dataclass(frozen=True, slots=True)
class Asked:
    """Which sightings are asked for: each of a name unless it is empty; in_view: those that there are some of.

    available: those that can be relied on now, or those that cannot; None for both. after: those behind this place.
    """

    robot: str = ""
    camera: str = ""
    name: str = ""
    in_view: bool = False
    available: bool | None = None
    after: Place | None = None


async def some_entries(inventory: Inventory, asked: Asked, most: int, now_ns: int) -> list[Entry]:
    """Return the first so many by place; others get their turn meanwhile."""
    found: list[Entry] = []
    order = inventory.in_order()
    behind = asked.after[:2] if asked.after else ("", "")
    begin = bisect_left(order, max(behind, (asked.robot, "")), key=PLACE)

    def wanted(key: CameraKey) -> bool:
        return len(found) < most and asked.robot in ("", key.robot)

    async for key in in_turns(takewhile(wanted, order[begin:])):
        if asked.camera in ("", key.camera):
            found += _entries_of(inventory, key, asked, now_ns)
    return found[:most]


def _entries_of(inventory: Inventory, key: CameraKey, asked: Asked, now_ns: int) -> Iterator[Entry]:
    view = inventory.camera(key)
    if view is None:
        return
    available = inventory.speaks(view, now_ns)
    if asked.available not in (None, available):
        return
    behind = asked.after[2] if asked.after and (key.robot, key.camera) == asked.after[:2] else None
    for of in sorted(view.sightings(now_ns - inventory.limits.stale_ns), key=attrgetter("name")):
        if (behind is None or of.name > behind) and asked.name in ("", of.name) and (of.count or not asked.in_view):
            yield Entry(of, available)
