"""Which objects of a site somebody asks for. Pure: time is an argument."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from services.monitor.world.site_objects import SITE, PlacedObject


@dataclass(frozen=True, slots=True)
class ObjectFilters:
    """Selects objects; a field that is empty or None selects all.

    name: the class. zone: whose centre is in it. robot: that it saw lately. seen_since_ns: seen then or later.
    unseen_since_ns: not seen since then. text: in the class, id, zones, or the names of robots that saw it.
    """

    name: str = ""
    zone: str = SITE
    robot: str = ""
    seen_since_ns: int | None = None
    unseen_since_ns: int | None = None
    text: str = ""

    def fit(self, placed: PlacedObject) -> bool:
        """Whether an object is asked for."""
        of = placed.of
        return (
            self.name in ("", of.name)
            and (self.zone == SITE or self.zone in placed.zones)
            and (not self.robot or any(seer.robot == self.robot for seer in of.seen_by))
            and (self.seen_since_ns is None or of.last_ns >= self.seen_since_ns)
            and (self.unseen_since_ns is None or of.last_ns <= self.unseen_since_ns)
            and (not self.text or self._has_text(placed))
        )

    def _has_text(self, placed: PlacedObject) -> bool:
        text, of = self.text.strip().casefold(), placed.of
        return any(
            text in each.casefold() for each in (of.name, of.id, *placed.zones, *(by.robot for by in of.seen_by))
        )


SORTS: Final[Mapping[str, Callable[[PlacedObject], Any]]] = {
    "name": lambda placed: (placed.of.name, placed.of.id),
    "id": lambda placed: placed.of.id,
    "zones": lambda placed: (placed.zones, placed.of.id),
    "first": lambda placed: (placed.of.first_ns, placed.of.id),
    "last": lambda placed: (placed.of.last_ns, placed.of.id),
    "existence": lambda placed: (placed.of.existence, placed.of.id),
}


def selected(
    objects: Iterable[PlacedObject], filters: ObjectFilters, *, sort: str = "name", descending: bool = False
) -> list[PlacedObject]:
    """Return the objects asked for, in order; by class and id where the order is unknown."""
    found = [each for each in objects if filters.fit(each)]
    found.sort(key=SORTS.get(sort, SORTS["name"]), reverse=descending)
    return found
