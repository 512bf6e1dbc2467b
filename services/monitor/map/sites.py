"""The sites that world models keep, by their own word. Pure: time is an argument."""

from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Final

from schemas.world import SiteStatus
from services.monitor.status_bytes import StatusBytes

FRESH_NS: Final = 5_000_000_000
"""Age from which a site's status is no longer current: its world model says one a second."""

MAX_SITES: Final = 1_000


@dataclass(frozen=True, slots=True)
class KnownSite:
    """What a site's world model said last, and when it came."""

    status: SiteStatus
    received_ns: int

    def is_current(self, now_ns: int) -> bool:
        """Whether the site is looked after now."""
        return now_ns - self.received_ns <= FRESH_NS


class Sites:
    """The newest status of each site, by name."""

    def __init__(self) -> None:
        self._known: dict[str, KnownSite] = {}
        self._bytes = StatusBytes[str]()

    def take(self, status: SiteStatus, received_ns: int, size: int = 0) -> None:
        """Take a status of `size` bytes; of more sites than MAX_SITES the one heard of longest ago is forgotten.

        Raises:
            SchemaError: there are too many bytes of statuses already, see `StatusBytes`.
        """
        for each in self._bytes.take(status.site, size):
            del self._known[each]
        self._known.pop(status.site, None)
        self._known[status.site] = KnownSite(status, received_ns)
        if len(self._known) > MAX_SITES:
            oldest = next(iter(self._known))
            self._bytes.drop(oldest)
            del self._known[oldest]

    def of(self, site: str) -> KnownSite | None:
        """Return what is known of a site, None if nothing is."""
        return self._known.get(site)

    def is_current(self, site: str, now_ns: int) -> bool:
        """Whether a site is looked after now."""
        known = self._known.get(site)
        return known is not None and known.is_current(now_ns)

    def classes(self, site: str) -> AbstractSet[str]:
        """Return the classes of which a site has objects."""
        known = self._known.get(site)
        return set() if known is None else known.status.objects.keys()

    def robots(self, site: str) -> list[str]:
        """Return the robots that drive in a site, as its world model says."""
        known = self._known.get(site)
        return [] if known is None else [each.robot for each in known.status.robots]

    def every(self) -> list[KnownSite]:
        """Return all sites by name."""
        return [self._known[name] for name in sorted(self._known)]

    def current(self, now_ns: int) -> Iterator[SiteStatus]:
        """Yield the statuses of sites that are looked after, by name."""
        return (each.status for each in self.every() if each.is_current(now_ns))


def totals(objects: Mapping[str, int]) -> str:
    """Return how many objects there are of each class, in words, such as `52 box, 25 pallet`."""
    counted = [f"{count} {name}" for name, count in sorted(objects.items()) if count]
    return ", ".join(counted) or "nothing yet"
