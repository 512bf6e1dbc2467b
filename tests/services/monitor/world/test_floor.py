"""When the floor of zones was looked at."""

import struct

import msgspec
import pytest

from schemas.world import LONG_AGO, FloorLooks
from services.monitor.world.floor import floor_of
from services.monitor.world.zones import Zone
from tests.services.monitor.world.test_site_objects import DOCK

S = 1_000_000_000


def looks(ages: list[list[int]]) -> FloorLooks:
    """Return a grid of square metres from the map's origin on, rows from the lowest y."""
    cells = [age for row in ages for age in row]
    columns = len(ages[0]) if ages else 0
    data = memoryview(struct.pack(f"<{len(cells)}H", *cells))
    return FloorLooks(site="hall", now_ns=0, origin=(0, 0), cell_m=1, columns=columns, rows=len(ages), ages=data)


def test_of_a_zone_s_floor_only_what_is_in_the_grid_was_ever_looked_at() -> None:
    grid = looks([[5, 5], [5, 5]])
    huge = Zone(name="huge", corners=((0, 0), (90_000, 0), (90_000, 90_000), (0, 90_000)))
    tiny = Zone(name="tiny", corners=((0.1, 0.1), (0.2, 0.1), (0.2, 0.2)))
    away = Zone(name="away", corners=((-9, -9), (-8, -9), (-8, -8)))
    wedge = Zone(name="wedge", corners=((0, 0), (2, 0), (0, 2)))
    floor = floor_of([huge, tiny, away, wedge, DOCK], grid, 0)
    shares = {name: each.share_seen(30, 0) for name, each in floor.items()}
    assert shares == {
        "huge": pytest.approx(0, abs=1e-6),
        "tiny": 1,
        "away": 0,
        "wedge": 1,
        "dock": 0.25,
    }
    assert {each.share_seen(30, 26 * S) for each in floor.values()} == {0}
    empty = floor_of([tiny], looks([]), 0)
    assert empty["tiny"].share_seen(30, 0) == 0


def test_a_zone_that_is_narrower_than_a_cell_has_the_cells_that_it_touches() -> None:
    grid = looks([[9, 5]] * 5 + [[9, LONG_AGO]] * 5)
    slanting = Zone(name="slanting", corners=((1.1, 0), (1.4, 0), (0.9, 10), (0.6, 10)))
    zones = [
        Zone(name="aisle", corners=((0.55, 0), (0.95, 0), (0.95, 10), (0.55, 10))),
        Zone(name="half", corners=((1.55, 0), (1.95, 0), (1.95, 10), (1.55, 10))),
        Zone(name="line", corners=((1.6, 0.5), (1.61, 0.5), (1.61, 4.5), (1.6, 4.5))),
        Zone(name="beyond", corners=((1.55, 3), (1.95, 3), (1.95, 23), (1.55, 23))),
        Zone(name="beside", corners=((2, 0), (2.4, 0), (2.4, 10), (2, 10))),
        Zone(name="square", corners=((0.6, 0.6), (1.4, 0.6), (1.4, 1.4), (0.6, 1.4))),
        slanting,
    ]
    shares = {name: each.share_seen(30, 0) for name, each in floor_of(zones, grid, 0).items()}
    assert shares == {
        "aisle": 1,
        "half": 0.5,
        "line": 1,
        "beyond": 0.1,
        "beside": 0,
        "square": 1,
        "slanting": 13 / 16,
    }


def test_looks_at_other_cells_than_before_are_not_taken_for_looks_at_these() -> None:
    before = floor_of([DOCK], looks([[10] * 4] * 4), 0)
    nothing = looks([[LONG_AGO] * 4] * 4)
    for other in (
        msgspec.structs.replace(nothing, origin=(0.5, 0.0)),
        msgspec.structs.replace(nothing, cell_m=0.5),
    ):
        assert floor_of([DOCK], other, S, before)["dock"].share_seen(30, S) == 0
    grown = msgspec.structs.replace(nothing, origin=(-3.0, -2.0))
    assert floor_of([DOCK], grown, S, before)["dock"].share_seen(30, S) == 1
