"""The legend and the list beside the map, as HTML in which names are escaped. Pure."""

from collections import Counter
from collections.abc import Sequence
from html import escape

import numpy as np

from schemas.world import FloorLooks, SiteStatus
from services.monitor.map.drawing import STALE, colour_of, is_fresh
from services.monitor.map.floor_plan import FLOOR_AGES_S, shades_of
from services.monitor.map.footprints import AGES_S, DrawnObject, address_of
from services.monitor.map.last_seen import MapObject
from services.monitor.web.pages.rows.formatting import ago, plural, seen_lately
from services.monitor.world.site_status import totals
from services.monitor.world.zones import ZoneCount


def rest_row(more: int) -> str:
    """Return the last line of a list of which more is not shown, as HTML."""
    return f'<div class="fs-line fs-muted">and {plural(more, "more", "more")}</div>' if more > 0 else ""


def object_keys(objects: Sequence[DrawnObject]) -> str:
    """Return the legend of a world model's objects as HTML, with how many are drawn of each class."""
    counts = Counter(each.of.name for each in objects)
    return "".join(
        f"<span>{_dot(colour_of(name))}<span>{count} {escape(name)}</span></span>"
        for name, count in sorted(counts.items())
    )


def object_row(each: DrawnObject, now_ns: int) -> str:
    """Return an object as HTML for the list: a link to its page."""
    of = each.of
    long = each.age == len(AGES_S)
    return (
        f'<a class="fs-row {"fs-stale" if long else ""}" href="{address_of(of)}" data-object="{escape(of.id)}">'
        f"{_dot(colour_of(of.name) if each.age < len(AGES_S) else STALE)}<div>{escape(f'{of.name} {of.id}')}</div>"
        f'<div class="fs-far">{seen_lately(of.last_ns, now_ns)}</div>'
        f'<div class="fs-more">at {of.at[0]:.1f}, {of.at[1]:.1f} m</div></a>'
    )


def in_words(status: SiteStatus) -> str:
    """Return what a world model says of a site, each object counted once."""
    problems = f" ({'; '.join(status.problems)})" if status.problems else ""
    return f"In {status.site}: {totals(status.objects)}{problems}"


def zone_in_words(counted: ZoneCount) -> str:
    """Return what is in a zone, or why that is not known."""
    zone = counted.zone
    known = totals(counted.objects) if counted.current else f"not known, as no world model tells of site {zone.site}"
    return f"Zone {zone.name}: {known}"


def floor_in_words(looks: FloorLooks | None) -> str:
    """Return which shares of the floor were looked at how long ago, or that it is not known."""
    if looks is None:
        return "When the floor was looked at is not known: no world model answers."
    seen = np.bincount(shades_of(looks).ravel(), minlength=len(FLOOR_AGES_S) + 2).tolist()
    total = sum(seen[1:])
    if not total:
        return "The floor was not looked at yet."
    ages = [f"within {words}" for words in FLOOR_AGES_S.values()] + ["longer ago"]
    told = [f"{seen[shade] / total:.0%} {age}" for shade, age in enumerate(ages, start=1) if seen[shade]]
    area = total * looks.cell_m**2
    return f"Of {area:,.0f} m² of floor that was looked at: {', '.join(told)}. The darker, the later."


def keys(marks: Sequence[MapObject], now_ns: int) -> str:
    """Return the legend as HTML, with the number of recently seen objects of each class."""
    counts = Counter(mark.name for mark in marks if is_fresh(mark, now_ns))
    told = [(colour_of(name), f"{counts[name]} {name}") for name in sorted({mark.name for mark in marks})]
    if stale := sum(not is_fresh(mark, now_ns) for mark in marks):
        told.append((STALE, f"{stale} not seen for a while"))
    return "".join(f"<span>{_dot(colour)}<span>{escape(text)}</span></span>" for colour, text in told)


def row(mark: MapObject, now_ns: int) -> str:
    """Return a mark as HTML for the list, which is one element."""
    fresh = is_fresh(mark, now_ns)
    return (
        f'<div class="fs-row {"" if fresh else "fs-stale"}">{_dot(colour_of(mark.name) if fresh else STALE)}'
        f'<div>{escape(mark.name)}</div><div class="fs-far">{ago(mark.seen_ns, now_ns)}</div>'
        f'<div class="fs-more">at {mark.x:.1f}, {mark.y:.1f} m, by {escape(f"{mark.robot}/{mark.camera}")}</div></div>'
    )


def _dot(colour: str) -> str:
    return f'<span class="fs-key" style="background: {colour}"></span>'
