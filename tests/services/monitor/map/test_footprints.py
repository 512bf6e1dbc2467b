import math
from xml.etree import ElementTree as ET

import msgspec
import pytest

from schemas.world import Seer, WorldObject
from services.monitor.map.footprints import (
    AGES_S,
    MOST_OBJECTS,
    DrawnObject,
    address_of,
    age_of,
    drawn_objects,
    footprint,
    newest_of,
)
from services.monitor.world.site_objects import PlacedObject
from tests.services.monitor.world.test_site_objects import thing

NS = 10**9
NOW = 10**18


def pallet(**given: object) -> WorldObject:
    return msgspec.structs.replace(
        thing("p1", 2.0, 1.0, "pallet"), **{"size": (1.2, 0.8, 0.1), "last_ns": NOW, **given}
    )


def drawn(*objects: WorldObject, chosen: str = "") -> ET.Element:
    some = [DrawnObject(each, age_of(each, NOW)) for each in objects]
    text = "".join(drawn_objects(some, lambda x, y: (x, y), lambda _: "#123456", chosen=chosen))
    return ET.fromstring(f"<svg>{text}</svg>")  # noqa: S314 - our own text


def test_a_footprint_is_the_box_turned_about_its_centre() -> None:
    assert footprint(pallet()) == ((2.6, 1.4), (2.6, 0.6), (1.4, 0.6), (1.4, 1.4))
    corners = footprint(pallet(yaw=math.pi / 2))
    assert [round(part, 6) for corner in corners for part in corner] == [1.6, 1.6, 2.4, 1.6, 2.4, 0.4, 1.6, 0.4]


def test_an_object_fades_in_steps_and_the_newest_are_on_top() -> None:
    ages = [0, *AGES_S]
    assert [age_of(pallet(last_ns=NOW - age * NS), NOW) for age in ages] == list(range(len(ages)))
    old, new = pallet(id="old", last_ns=NOW - AGES_S[0] * NS), pallet(id="new")
    groups = drawn(new, old).findall("g")
    assert [(group.get("class"), group[0].get("href")) for group in groups] == [
        ("things age1", "/world/hall/old"),
        ("things age0", "/world/hall/new"),
    ]


def test_an_object_is_a_link_with_a_name_and_one_that_moves_has_a_line() -> None:
    still, moving = pallet(id="a b/<c>"), pallet(id="m", velocity=(1.0, -2.0))
    group = drawn(still, moving, chosen="m").find("g")
    assert group is not None
    one, other = group
    assert (one.get("href"), one.get("aria-label"), one.get("class")) == (address_of(still), "pallet a b/<c>", None)
    assert one.get("href") == "/world/hall/a%20b%2F%3Cc%3E"
    assert (len(one), other.get("class")) == (2, "chosen")
    line = other.find("line")
    assert line is not None
    assert [line.get(each) for each in ("x1", "y1", "x2", "y2")] == ["2.0", "1.0", "3.0", "-1.0"]
    assert drawn(pallet(velocity=(0.01, 0.0))).find(".//line") is None


def test_the_newest_of_a_class_or_robot_are_drawn_and_all_are_counted() -> None:
    seers = [Seer(robot="r1", camera="front", last_ns=1)]
    some = [pallet(id=f"p{number}", last_ns=NOW - number) for number in range(MOST_OBJECTS + 2)]
    some += [pallet(id="b", name="box", last_ns=NOW - 10**15, seen_by=seers)]
    placed = [PlacedObject(each, ()) for each in some]
    found, count = newest_of(placed, NOW)
    assert (len(found), count, found[0].of.id) == (MOST_OBJECTS, MOST_OBJECTS + 3, "p0")
    for (only,), count in (newest_of(placed, NOW, name="box"), newest_of(placed, NOW, robot="r1")):
        assert (only.of.id, count) == ("b", 1)
    (unknown,), _ = newest_of(placed[:1], NOW, known=False)
    assert unknown.age == len(AGES_S)


@pytest.mark.parametrize("yaw", [None, 0.3])
def test_a_footprint_has_the_size_of_the_box(yaw: float | None) -> None:
    one, two, three, _ = footprint(pallet(yaw=yaw))
    assert (math.dist(one, two), math.dist(two, three)) == pytest.approx((0.8, 1.2))
