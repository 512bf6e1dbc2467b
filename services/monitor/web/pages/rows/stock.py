"""Rows of the inventory page: how many objects of each class are in a site and its zones, and the objects. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Final
from urllib.parse import urlencode

from services.monitor.map.footprints import address_of
from services.monitor.web.pages.rows.formatting import NOTHING, WHEN, ago, iso, seen_lately
from services.monitor.world.selection import ObjectFilters
from services.monitor.world.site_objects import SITE, PlacedObject, SiteObjects

WHOLE_SITE: Final = "whole site"


@dataclass(frozen=True, slots=True)
class StockLine:
    """How many objects of a class are in a zone. zone: SITE for all of the site."""

    zone: str
    name: str
    count: int


LINE_SORTS: Final[Mapping[str, Callable[[StockLine], Any]]] = {
    "zone": lambda line: (line.zone, -line.count, line.name),
    "name": lambda line: (line.name, line.zone),
    "count": lambda line: (line.count, line.name, line.zone),
}


def stock_lines(
    site: SiteObjects, *, name: str = "", zone: str = SITE, sort: str = "zone", descending: bool = False
) -> list[StockLine]:
    """Return how many objects of each class are in all of a site, and in each zone; of one class or zone if given."""
    zones = (SITE, *(each.name for each in site.zones)) if zone == SITE else (zone,)
    lines = [
        StockLine(each, of, count)
        for each in zones
        for of, count in site.count(each).items()
        if count and name in ("", of)
    ]
    return sorted(lines, key=LINE_SORTS.get(sort, LINE_SORTS["zone"]), reverse=descending)


def stock_row(line: StockLine, site: str, *, current: bool) -> dict[str, Any]:
    """Return a line as a row of the page's templates."""
    return {
        "key": f"{site}/{line.zone}/{line.name}",
        "zone": line.zone or WHOLE_SITE,
        "at": line.zone,
        "name": line.name,
        "count": f"{line.count:,}",
        "current": current,
    }


def object_row(placed: PlacedObject, now_ns: int, *, current: bool) -> dict[str, Any]:
    """Return an object as a row of the page's templates."""
    of = placed.of
    by = of.seen_by[0] if of.seen_by else None
    return {
        "id": of.id,
        "href": address_of(of),
        "name": of.name,
        "zones": ", ".join(placed.zones) or NOTHING,
        "at": f"{of.at[0]:.1f}, {of.at[1]:.1f} m",
        "first": ago(of.first_ns, now_ns),
        "first_at": iso(of.first_ns),
        "last": seen_lately(of.last_ns, now_ns),
        "last_at": iso(of.last_ns),
        "existence": f"{of.existence:.0%}",
        "by": NOTHING if by is None else f"{by.robot}/{by.camera}",
        "current": current,
    }


def tiles_of(counts: Mapping[str, int], most: int, chosen: str = "") -> Sequence[str]:
    """Return the classes of which there are most, the chosen one among them."""
    there = sorted((name for name, count in counts.items() if count), key=lambda name: (-counts[name], name))[:most]
    return [*there[: most - 1], chosen] if chosen and chosen not in there else there


def csv_link(site: str, filters: ObjectFilters) -> str:
    """Return a link to the file of the objects of a site, class and zone, as HTML."""
    query = {"site": site, "class": filters.name, "zone": filters.zone, "bom": "true"}
    url = f"/api/v1/objects/export?{urlencode({name: value for name, value in query.items() if value})}"
    return f'<a class="fs-link fs-small" download href="{escape(url)}">Objects as CSV</a>'


CHOOSE: Final = "$parent.$emit('choose', [props.row.at, props.row.name])"

STOCK_BODY: Final = f"""
<q-tr :props="props" :class="props.row.current ? '' : 'fs-stale'" :data-stock="props.row.key">
  <q-td key="zone" :props="props" class="fs-wide">{{{{ props.row.zone }}}}</q-td>
  <q-td key="name" :props="props" class="fs-wide"><button class="fs-link" title="its objects, and how many over time"
    @click="{CHOOSE}">{{{{ props.row.name }}}}</button></q-td>
  <q-td key="count" :props="props"><b>{{{{ props.row.count }}}}</b></q-td>
</q-tr>
"""

STOCK_CARD: Final = f"""
<div :class="props.row.current ? 'fs-card' : 'fs-card fs-stale'" :data-stock="props.row.key">
  <div class="fs-top"><span><button class="fs-chip" @click="{CHOOSE}"><b>{{{{ props.row.count }}}}</b
    >{{{{ props.row.name }}}}</button></span><span class="fs-small">{{{{ props.row.zone }}}}</span></div>
</div>
"""

LINK: Final = '<a class="fs-link" :href="props.row.href">{{ props.row.id }}</a>'

OBJECT_BODY: Final = f"""
<q-tr :props="props" :class="props.row.current ? '' : 'fs-stale'" :data-object="props.row.id">
  <q-td key="name" :props="props" class="fs-wide">{{{{ props.row.name }}}}</q-td>
  <q-td key="id" :props="props" class="fs-wide">{LINK}</q-td>
  <q-td key="zones" :props="props" class="fs-wide">{{{{ props.row.zones }}}}
    <div class="fs-muted fs-small">{{{{ props.row.at }}}}</div></q-td>
  <q-td key="first" :props="props" {WHEN.format(at="props.row.first_at")}>{{{{ props.row.first }}}}</q-td>
  <q-td key="last" :props="props" {WHEN.format(at="props.row.last_at")}>{{{{ props.row.last }}}}
    <div class="fs-muted fs-small">{{{{ props.row.by }}}}</div></q-td>
  <q-td key="existence" :props="props">{{{{ props.row.existence }}}}</q-td>
</q-tr>
"""

OBJECT_CARD: Final = f"""
<div :class="props.row.current ? 'fs-card' : 'fs-card fs-stale'" :data-object="props.row.id">
  <div class="fs-top"><span><strong>{{{{ props.row.name }}}}</strong> {LINK}</span
    ><span class="fs-muted fs-small">{{{{ props.row.last }}}}</span></div>
  <div class="fs-muted fs-small">{{{{ props.row.zones }}}}, at {{{{ props.row.at }}}}, {{{{ props.row.existence }}}},
    first seen {{{{ props.row.first }}}}, last by {{{{ props.row.by }}}}</div>
</div>
"""
