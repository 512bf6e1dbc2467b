"""The key and rows of the map page, and its floor plan."""

from dataclasses import replace

import httpx
from starlette.applications import Starlette

from services.monitor.liveness import OBJECT_FRESH_NS
from services.monitor.map.drawing import STALE, colour_of
from services.monitor.map.floor_plan import FloorPlan
from services.monitor.map.last_seen import MapObject
from services.monitor.web.pages.map import floor_plan_route, url_of
from services.monitor.web.pages.rows.map import keys, row, zone_in_words
from services.monitor.world.zones import Zone, ZoneCount

NOW = 10**18
HTML = "<b onclick=x>"


def mark(name: str = "box", seen_ns: int = NOW) -> MapObject:
    return MapObject(name, 1.25, -2.0, "r1", "front", seen_ns)


def test_a_key_says_how_many_were_seen_just_now() -> None:
    told = keys(
        [mark(), mark(), mark(seen_ns=NOW - OBJECT_FRESH_NS - 1), mark("pallet", NOW - OBJECT_FRESH_NS - 1)], NOW
    )
    assert "2 box" in told
    assert "0 pallet" in told
    assert "2 not seen for a while" in told
    assert colour_of("box") in told


def test_what_was_not_seen_for_a_while_is_grey() -> None:
    assert "fs-stale" not in row(mark(), NOW)
    old = row(mark(seen_ns=NOW - OBJECT_FRESH_NS - 1), NOW)
    assert "fs-stale" in old
    assert STALE in old
    assert "at 1.2, -2.0 m, by r1/front" in old


def test_names_are_text() -> None:
    assert HTML not in keys([mark(HTML)], NOW) + row(mark(HTML), NOW)
    assert "&lt;b onclick=x&gt;" in row(mark(HTML), NOW)


def test_a_zone_is_told_with_its_objects_or_why_these_are_not_known() -> None:
    zone = Zone(name=HTML, site="hall", corners=((0, 0), (4, 0), (4, 4)))
    assert zone_in_words(ZoneCount(zone, {"box": 2, "pallet": 0}, current=True)) == f"Zone {HTML}: 2 box"
    assert "no world model tells of site hall" in zone_in_words(ZoneCount(zone, {"box": 2}, current=False))


PLAN = FloorPlan(b"\x89PNG", 3.0, 2.0, 0.0, 0.0, 0.0, ())


async def test_its_image_is_fetched_once_and_another_one_has_another_name() -> None:
    transport = httpx.ASGITransport(Starlette(routes=[floor_plan_route(PLAN)]))
    async with httpx.AsyncClient(transport=transport, base_url="http://here") as client:
        answer = await client.get(url_of(PLAN))
        assert (answer.content, answer.headers["content-type"]) == (PLAN.png, "image/png")
        assert "immutable" in answer.headers["cache-control"]
        other = await client.get(url_of(replace(PLAN, png=b"other")))
        assert other.status_code == 404
