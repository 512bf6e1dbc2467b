import msgspec

from schemas.world import Seer
from services.monitor.web.pages.rows.stock import StockLine, object_row, stock_lines, stock_row, tiles_of
from services.monitor.world.selection import ObjectFilters, selected
from services.monitor.world.site_objects import SITE, PlacedObject, SiteObjects
from tests.services.monitor.world.test_site_objects import DOCK, RACK, thing

S = 10**9
NOW = 10**18


def site() -> SiteObjects:
    found = SiteObjects([DOCK, RACK])
    by = [Seer(robot="r1", camera="front", last_ns=NOW)]
    old = msgspec.structs.replace(thing("b", 9), last_ns=NOW - 60 * S, existence=0.5)
    found.replace("e", 0, [thing("p", 3.5, name="pallet"), msgspec.structs.replace(thing("a", 1), seen_by=by), old])
    return found


def ids(filters: ObjectFilters, **order: object) -> list[str]:
    return [each.of.id for each in selected(site().objects.values(), filters, **order)]  # type: ignore[arg-type]


def test_objects_are_chosen_by_class_zone_robot_age_and_text() -> None:
    assert ids(ObjectFilters()) == ["a", "b", "p"]
    assert ids(ObjectFilters(name="box", zone="dock")) == ["a"]
    assert ids(ObjectFilters(zone="rack")) == ["p"]
    assert ids(ObjectFilters(robot="r1")) == ["a"]
    assert ids(ObjectFilters(seen_since_ns=NOW - 60 * S)) == ["b"]
    assert ids(ObjectFilters(unseen_since_ns=NOW - 60 * S - 1)) == ["a", "p"]
    assert [ids(ObjectFilters(text=text)) for text in ("PALL", " r1 ", "rack", "b", "zz")] == [
        ["p"], ["a"], ["p"], ["a", "b"], []
    ]  # fmt: skip


def test_they_are_in_the_order_that_is_asked_for() -> None:
    assert ids(ObjectFilters(), sort="last", descending=True) == ["b", "p", "a"]
    assert ids(ObjectFilters(), sort="existence") == ["b", "a", "p"]
    assert ids(ObjectFilters(), sort="zones") == ["b", "a", "p"]
    assert ids(ObjectFilters(), sort="nonsense") == ["a", "b", "p"]


def test_stock_is_of_the_whole_site_and_of_each_zone_without_what_there_is_none_of() -> None:
    of = site()
    assert stock_lines(of) == [
        StockLine(SITE, "box", 2),
        StockLine(SITE, "pallet", 1),
        StockLine("dock", "box", 1),
        StockLine("dock", "pallet", 1),
        StockLine("rack", "pallet", 1),
    ]
    assert stock_lines(of, name="box", sort="count") == [StockLine("dock", "box", 1), StockLine(SITE, "box", 2)]
    assert stock_lines(of, zone="rack") == [StockLine("rack", "pallet", 1)]
    row = stock_row(StockLine(SITE, "box", 1_200), "hall", current=True)
    assert (row["key"], row["zone"], row["at"], row["count"]) == ("hall//box", "whole site", "", "1,200")


def test_an_object_s_row_leads_to_its_page() -> None:
    of = site().objects
    row = object_row(of["a"], NOW, current=True)
    assert (row["href"], row["zones"], row["by"]) == ("/world/hall/a", "dock", "r1/front")
    nowhere = object_row(PlacedObject(thing("x", 99), ()), NOW, current=False)
    assert (nowhere["zones"], nowhere["by"], nowhere["current"]) == ("\N{EN DASH}", "\N{EN DASH}", False)


def test_tiles_are_the_classes_of_which_there_are_most_and_the_chosen_one() -> None:
    counts = {"a": 1, "b": 3, "c": 2, "none": 0}
    assert tiles_of(counts, 2) == ["b", "c"]
    assert tiles_of(counts, 2, "a") == ["b", "a"]
    assert tiles_of(counts, 9, "none") == ["b", "c", "a", "none"]
