"""The sites of the fleet as their world models report them: totals, problems, and which are current. Pure."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from typing import Final

from schemas.printing import printable
from schemas.world import SiteStatus
from services.monitor.formats import limited
from services.monitor.status_bytes import StatusBytes

FRESH_NS: Final = 5_000_000_000
"""Age from which a site's status is no longer current: its world model says one a second."""

MAX_SITES: Final = 1_000

LATELY_NS: Final = 60_000_000_000
"""How long something that is left out stays a problem: it is counted since the world model began."""

JUMP_NS: Final = 30_000_000_000
"""How long a robot may be left out because its pose has jumped, before it is a problem: a pose that was set right jumps
as well, and fits soon.
"""

JUMPED: Final = "has jumped"

MAX_NAMED: Final = 3
LEFT_OUT: Final = " sightings left out: "

DOUBTS: Final[Mapping[str, str]] = {
    "its depth": "check the depth camera, how it is mounted, and its transform",
    "its pose": "correct that in its localisation, as with 2D Pose Estimate in RViz",
}
"""Cures by a part of the reason for which a robot is doubted."""

CURES: Final[Mapping[str, str]] = {
    "without a map frame": "robots have no frame map, so that what they see has no place: start their localisation, "
    "which publishes the transform from map to base_link",
    "in another frame": "views are left out, as they are in another frame than the site's map: say what robots call it"
    " with fleetsight worldmodel --frame",
    "far from when they came": "stamps of views are more than 5 s from when they came: set the clocks of the robots and"
    " of the world model's machine by NTP",
    "its most objects": "there is no room for more objects: raise fleetsight worldmodel --most-objects, or divide the"
    " site (--sites)",
    "its most robots": "there is no room for more robots: divide the site (fleetsight worldmodel --sites)",
    "its most cameras": "a robot has more cameras than count: let it publish fewer",
    "malformed views": "views cannot be read: let distance workers and the world model be of one release",
    "could not be taken in": "views could not be taken in: the world model's log says why",
    "another model's class names": "robots have other names for the same things, each by its model: let all of a site"
    " run one model, or models with the same class names",
}
"""Cures by a part of the reason for which sightings or views are left out. Other reasons need none: an object is too
far away, or a newer view came.
"""


@dataclass(frozen=True, slots=True)
class KnownSite:
    """The newest status of a site's world model, and when it came.

    growing: when more was left out last, by reason; of those reasons of which that happened since they were heard of.
    jumped: since when robots are doubted as their poses have jumped, by name.
    """

    status: SiteStatus
    received_ns: int
    growing: Mapping[str, int] = field(default_factory=dict)
    jumped: Mapping[str, int] = field(default_factory=dict)

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
        before = self._known.pop(status.site, None)
        growing, jumped = _growing(before, status, received_ns), _jumped(before, status, received_ns)
        self._known[status.site] = KnownSite(status, received_ns, growing, jumped)
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

    def problems(self, now_ns: int) -> list[str]:
        """Return what keeps world models that are there from being right, in some lines, with the cure."""
        return limited([line for each in self.every() if each.is_current(now_ns) for line in _problems(each, now_ns)])

    def current(self, now_ns: int) -> Iterator[SiteStatus]:
        """Yield the statuses of sites that are looked after, by name."""
        return (each.status for each in self.every() if each.is_current(now_ns))


def _growing(before: KnownSite | None, status: SiteStatus, now_ns: int) -> dict[str, int]:
    """Return when more was left out last, by reason; a world model that took the site over counts from 0."""
    if before is None or before.status.epoch != status.epoch:
        return {}
    counted = before.status.left_out
    grown = {reason: now_ns for reason, count in status.left_out.items() if count > counted.get(reason, 0)}
    return {**before.growing, **grown}


def _jumped(before: KnownSite | None, status: SiteStatus, now_ns: int) -> dict[str, int]:
    """Return since when poses have jumped, by robot."""
    since_ns = {} if before is None else before.jumped
    return {each.robot: since_ns.get(each.robot, now_ns) for each in status.robots if JUMPED in each.doubted}


def _problems(known: KnownSite, now_ns: int) -> Iterator[str]:
    """Yield what is wrong with a site, in lines: robots that are lost first, then what is left out, then the rest."""
    status, site = known.status, f"site {known.status.site}"
    doubted = [each for each in status.robots if each.doubted]
    lost = defaultdict[str, list[str]](list)
    for each in doubted:
        is_off = status.sent_ns - each.last_ns > LATELY_NS  # and stays as it was last
        if not is_off and now_ns - known.jumped.get(each.robot, -JUMP_NS) >= JUMP_NS:
            lost[each.doubted].append(each.robot)
    for why, robots in lost.items():
        cure = next((f"; {cure}" for part, cure in DOUBTS.items() if part in why), "")
        yield f"{site} leaves out the sightings of {_named(robots)}: {printable(why)}{cure}"
    told = {f"{each.robot}: {each.doubted}" for each in doubted}
    for part, cure in CURES.items():
        reasons = [reason for reason, at_ns in known.growing.items() if part in reason and now_ns - at_ns <= LATELY_NS]
        if reasons:
            by = [printable(each.split(":")[0]) for each in status.problems if LEFT_OUT in each and part in each]
            yield f"{site}: {cure}{f' ({_named(by)})' if by else ''}"
    others = (each for each in status.problems if LEFT_OUT not in each and each not in told)
    yield from (f"{site}: {printable(each)}" for each in others)


def _named(robots: Sequence[str]) -> str:
    rest = len(robots) - MAX_NAMED
    return ", ".join(robots[:MAX_NAMED]) + (f" and {rest} more" if rest > 0 else "")


def totals(objects: Mapping[str, int]) -> str:
    """Return how many objects there are of each class, in words, such as `52 box, 25 pallet`."""
    counted = [f"{count} {name}" for name, count in sorted(objects.items()) if count]
    return ", ".join(counted) or "nothing yet"
