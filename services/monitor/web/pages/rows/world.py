"""An object of a site in words: what it is, where, since when, and what became of it. Pure: time is an argument."""

import math
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from typing import Final

from schemas.keys import CameraKey
from schemas.world import ChangeKind, WorldObject
from services.monitor.history.world_history import ObjectEvent
from services.monitor.map.footprints import MOVING_MPS
from services.monitor.web.pages.rows.formatting import NS, ago, iso, lasting, seen_lately

IN_VIEW_NS: Final = 3 * NS
"""An object that a camera saw so lately is in its view: three views a second are usual."""

COMPASS: Final = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")
"""Directions in the map, whose x axis points east, by eighths of a turn."""


def cameras_in_view(of: WorldObject, now_ns: int) -> list[CameraKey]:
    """Return the cameras that have an object in view, the latest first. now_ns: on the model's clock."""
    return [CameraKey(each.robot, each.camera) for each in of.seen_by if now_ns - each.last_ns <= IN_VIEW_NS]


def object_facts(of: WorldObject, zones: Sequence[str], now_ns: int) -> str:
    """Return what is known of an object as HTML, a term and its description each."""
    facts = [
        ("Class", escape(of.name)),
        ("Where", f"{of.at[0]:.2f}, {of.at[1]:.2f} m, {of.at[2]:.2f} m up, {_surely(of)}"),
        ("Zones", escape(", ".join(zones)) or "in none"),
        ("Size", _size(of)),
        ("First seen", _when(of.first_ns, f"{lasting(max(0, now_ns - of.first_ns) / NS)} ago")),
        ("Last seen", _when(of.last_ns, seen_lately(of.last_ns, now_ns))),
        (
            "Last looked for, not found",
            _when(of.looked_ns, ago(of.looked_ns, now_ns)) if of.looked_ns else "never since it was seen",
        ),
        ("Seen by", "".join(f"<div>{each}</div>" for each in _seers(of, now_ns)) or "nobody yet"),
        ("Sightings", f"{of.sightings:,}"),
        ("Existence", f"{_percent(of.existence)} probable"),
        *([] if of.velocity is None else [("Moves", _course(of.velocity))]),
    ]
    return "".join(f"<dt>{term}</dt><dd>{text}</dd>" for term, text in facts)


def _when(at_ns: int, text: str) -> str:
    return f'<time datetime="{iso(at_ns)}" title="{iso(at_ns)}">{text}</time>'


def _surely(of: WorldObject) -> str:
    xx, _, _, yy, *_ = of.covariance
    return f"&plusmn; {math.sqrt(max(xx, yy, 0.0)):.2f} m"


def _size(of: WorldObject) -> str:
    size = " &times; ".join(f"{each:.2f}" for each in of.size)
    turned = "" if of.yaw is None else f", its length at {math.degrees(of.yaw):.0f}&deg; to the map's x axis"
    return f"{size} m (length, width, height){turned}"


def _percent(share: float) -> str:
    return ">99.9 %" if share > 0.999 else f"{share:.1%}".replace("%", " %")


def _seers(of: WorldObject, now_ns: int) -> Iterator[str]:
    for seer in of.seen_by:
        where = escape(f"{seer.robot}/{seer.camera}")
        yield f'<a class="fs-link" href="/cameras/{where}">{where}</a>, {seen_lately(seer.last_ns, now_ns)}'


def _course(velocity: tuple[float, float]) -> str:
    speed = math.hypot(*velocity)
    if speed < MOVING_MPS:
        return "stands still"
    eighth = round(math.atan2(velocity[1], velocity[0]) / math.tau * len(COMPASS)) % len(COMPASS)
    return f"{speed:.1f} m/s towards the map's {COMPASS[eighth]}"


def event_rows(events: Iterable[ObjectEvent], now_ns: int) -> str:
    """Return what became of an object as HTML, a row for each event."""
    return "".join(
        f'<div class="fs-row" data-event="{escape(each.kind)}"><div>{escape(each.kind.capitalize())}</div>'
        f'<div>{_became(each)}</div><div class="fs-far">{_when(each.until_ns, ago(each.until_ns, now_ns))}</div></div>'
        for each in events
    )


def _became(event: ObjectEvent) -> str:
    at, by = f"{event.x:.1f}, {event.y:.1f} m", f", as {escape(event.by)} saw" if event.by else ""
    match event.kind:
        case ChangeKind.MOVED if event.from_x is not None and event.from_y is not None:
            far_m = math.hypot(event.x - event.from_x, event.y - event.from_y)
            return f"from {event.from_x:.1f}, {event.from_y:.1f} to {at}, {far_m:.1f} m away{by}"
        case ChangeKind.GONE:
            return f"from {at}{by}"
        case ChangeKind.MERGED:
            return f"into {escape(event.into)}, which it turned out to be{by}"
    return f"at {at}{by}"
