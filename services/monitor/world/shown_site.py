"""Which site a page shows, and in one line why its objects are not known. Pure: time is an argument."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from services.monitor.world.site_objects import SiteObjects, World
from services.monitor.world.site_status import KnownSite, Sites

NS: Final = 1_000_000_000
KEPT_NS: Final = 60 * NS
"""How long a site's objects are shown, as out of date, after its world model was heard last."""

NO_MAP: Final = "without a map frame"
"""World models' reason for leaving out sightings that have no place in the map."""

OFF: Final = "Views only: this monitor was started with --world off, so nothing of the world models is known here."


@dataclass(frozen=True, slots=True)
class ShownSite:
    """The site of a page. name: empty where there is none. objects: None where they are not known, or long out of date.

    current: the objects are known as of now. notice: what is missing, and the cure, in one line; else empty.
    """

    name: str = ""
    objects: SiteObjects | None = None
    current: bool = False
    notice: str = ""


def site_names(world: World, sites: Sites) -> list[str]:
    """Return the sites that are followed and that a world model told of, by name."""
    told = {known.status.site for known in sites.every()}
    return sorted(world.sites.keys() & told)


def shown_site(world: World, sites: Sites, now_ns: int, *, chosen: str = "", join: str = "") -> ShownSite:
    """Return the chosen site, or the first whose world model is there. join: the endpoint to connect to."""
    if not world.on:
        return ShownSite(notice=OFF)
    start = f"start one: fleetsight worldmodel --connect {join}"
    names = site_names(world, sites)
    if not names:
        return ShownSite(notice=f"No world model runs, so only what each camera has in view is known; {start}")
    there = [name for name in names if sites.is_current(name, now_ns)]
    name = chosen if chosen in names else (there or names)[0]
    objects, known = world.sites[name], sites.of(name)
    if known is None:
        return ShownSite(name, notice=f"No world model serves {name}; {start}")
    if not known.is_current(now_ns):
        return _silent(name, objects, known, now_ns, start)
    if objects.is_behind:
        return ShownSite(name, objects, notice=f"All objects of {name} are being asked for.")
    return ShownSite(name, objects, current=True, notice=_without_map(objects, known))


def _silent(name: str, objects: SiteObjects, known: KnownSite, now_ns: int, start: str) -> ShownSite:
    since = f"The world model of {name} was last heard at {_time(known.received_ns)}"
    if now_ns - known.received_ns <= KEPT_NS:
        return ShownSite(name, objects, notice=f"{since}; its objects are as they were then.")
    return ShownSite(name, notice=f"{since}, so only what each camera has in view is known; {start}")


def _without_map(objects: SiteObjects, known: KnownSite) -> str:
    """Return why there are no objects, where robots have no map."""
    if objects.objects or not any(NO_MAP in reason for reason in known.status.left_out):
        return ""
    return (
        f"The world model of {known.status.site} cannot place what its robots see: they have no frame map; "
        "start their localisation, which publishes the transform from map to base_link."
    )


def _time(at_ns: int) -> str:
    return datetime.fromtimestamp(at_ns / NS, UTC).strftime("%H:%M:%S UTC")
