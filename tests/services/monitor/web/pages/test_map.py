"""The key and rows of the map page, and its floor plan."""

from dataclasses import replace

import httpx
import numpy as np
from starlette.applications import Starlette

from schemas.world import FloorLooks
from services.monitor.liveness import OBJECT_FRESH_NS
from services.monitor.map.drawing import STALE, colour_of
from services.monitor.map.floor_plan import FloorPlan
from services.monitor.map.last_seen import MapObject
from services.monitor.web.pages.map import floor_plan_route, url_of
from services.monitor.web.pages.rows.map import floor_in_words, keys, row, zone_in_words
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


def test_how_long_ago_the_floor_was_looked_at_is_said_in_words() -> None:
    def looks(*ages: int) -> FloorLooks:
        told = memoryview(np.array(ages, "<u2").tobytes())
        return FloorLooks(site="main", now_ns=1, origin=(0.0, 0.0), cell_m=2.0, columns=len(ages), rows=1, ages=told)

    assert floor_in_words(looks(5, 20, 61, 65_534, 65_535)) == (
        "Of 16 m² of floor that was looked at: 50% within a minute, 25% within 10 minutes, 25% longer ago."
        " The darker, the later."
    )
    assert "not looked at yet" in floor_in_words(looks(65_535))
    assert "not looked at yet" in floor_in_words(looks())
    assert "not known" in floor_in_words(None)
