"""The inventory as a table that can be searched, sorted and counted. Pure."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final

from services.monitor.inventory.inventory import Entry
from services.monitor.natural_order import natural, natural_camera


@dataclass(frozen=True, slots=True)
class Filters:
    """Which sightings are to be shown: `text` is in one of their names.

    in_view: only what is known to be in view now; what a robot saw that is silent or gone is not.
    """

    text: str = ""
    name: str = ""
    in_view: bool = True
    sort: str = "robot"
    descending: bool = False


SORTS: Final[Mapping[str, Callable[[Entry], Any]]] = {
    "robot": lambda entry: natural_camera(entry.sighting.key),
    "camera": lambda entry: natural_camera(entry.sighting.key)[::-1],
    "name": lambda entry: natural(entry.sighting.name),
    "count": attrgetter("sighting.count"),
    "score": attrgetter("sighting.score"),
    "first": attrgetter("sighting.first_ns"),
    "last": attrgetter("sighting.last_ns"),
    "nearest": lambda entry: float("inf") if entry.sighting.nearest_m is None else entry.sighting.nearest_m,
}


class Stock:
    """Every sighting at one moment. What was asked for once is kept, as many ask the same.

    totals: how many objects of each class are in view where that is known now, the most first. It is a sum over the
    views of cameras: what two of them see counts twice. views: how many cameras have each class in view.
    unknown: sightings that went on when their cameras fell silent, or their robots went.
    """

    def __init__(self, entries: Sequence[Entry]) -> None:
        self.entries = entries
        self._kept: dict[Filters, Sequence[Entry]] = {}
        self.unknown = sum(entry.sighting.count > 0 and not entry.available for entry in entries)
        totals, self.views = Counter[str](), Counter[str]()
        for entry in entries:
            if is_in_view(entry):
                totals[entry.sighting.name] += entry.sighting.count
                self.views[entry.sighting.name] += 1
        self.totals: Mapping[str, int] = dict(totals.most_common())

    def wanted(self, filters: Filters) -> Sequence[Entry]:
        """Return the sightings that are wanted in the order that is."""
        if filters not in self._kept:
            text = filters.text.strip().casefold()
            found = [entry for entry in self.entries if _is_wanted(entry, filters, text)]
            key = SORTS.get(filters.sort, SORTS["robot"])
            self._kept[filters] = sorted(found, key=key, reverse=filters.descending)
        return self._kept[filters]


def is_in_view(entry: Entry) -> bool:
    """Whether there is some of it in view, as far as is known now."""
    return entry.available and entry.sighting.count > 0


def _is_wanted(entry: Entry, filters: Filters, text: str) -> bool:
    of = entry.sighting
    if filters.in_view and not is_in_view(entry):
        return False
    if filters.name not in ("", of.name):
        return False
    return not text or any(
        text in each.casefold() for each in (of.key.robot, of.key.camera, of.name, of.model, of.worker)
    )
