"""Some of what is in view, found without listing all of it."""

from bisect import bisect_left
from dataclasses import dataclass
from itertools import takewhile
from operator import attrgetter
from typing import Final

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
    order = inventory.in_order(asked.robot)
    begin = bisect_left(order, asked.after[:2], key=PLACE) if asked.after else 0
    async for key in in_turns(takewhile(lambda _: len(found) < most, order[begin:])):
        if asked.camera in ("", key.camera):
            found.extend(each for each in inventory.entries_of(key, now_ns) if _is_wanted(each, asked))
    return found[:most]


def _is_wanted(entry: Entry, asked: Asked) -> bool:
    of = entry.sighting
    follows = asked.after is None or (of.key.robot, of.key.camera, of.name) > asked.after
    is_like = asked.name in ("", of.name) and asked.available in (None, entry.available)
    return follows and is_like and (of.count > 0 or not asked.in_view)
