import re
from xml.etree import ElementTree as ET

import pytest

from services.monitor.liveness import OBJECT_FRESH_NS
from services.monitor.map.drawing import MOST_SHOWN, Bounds, colour_of, ground_of, is_fresh, svg_of
from services.monitor.map.floor_plan import FloorPlan
from services.monitor.map.footprints import DrawnObject
from services.monitor.map.last_seen import MapObject
from services.monitor.map.pose import DrawnRobot, Pose
from services.monitor.world.zones import Zone, ZoneCount
from tests.services.monitor.world.test_site_objects import thing

NOW = 1_000_000_000_000
BOUNDS = Bounds(-2, -2, 10, 5)
SVG = "{http://www.w3.org/2000/svg}"


def mark(x: float = 1.0, y: float = 1.0, *, name: str = "box", seen_ns: int = NOW) -> MapObject:
    return MapObject(name, x, y, "r1", "front", seen_ns)


def drawn(text: str) -> ET.Element:
    return ET.fromstring(text)  # noqa: S314 - our own text


def test_bounds_are_whole_metres_around_everything_and_never_shrink() -> None:
    first = Bounds.around([(0.2, 0.2), (3.5, 1.0)])
    assert first == Bounds(-1, -1, 5, 2)
    assert Bounds.around([(9.0, 0.5)], first) == Bounds(-1, -1, 10, 2)
    assert Bounds.around([], first) == first
    assert Bounds.around([]) is None
    assert Bounds.around([(1e9, 0.0)]) is None


def test_fresh_marks_have_their_class_s_colour_and_stale_ones_are_grey() -> None:
    marks = [mark(), mark(2, 2, seen_ns=NOW - OBJECT_FRESH_NS), mark(3, 3, seen_ns=NOW - OBJECT_FRESH_NS - 1)]
    circles = drawn(svg_of(BOUNDS, marks, [], NOW)).findall("circle")
    colour = colour_of("box")
    assert [circle.get("fill") for circle in circles] == ["#9e9e9e", colour, colour]  # the newest on top
    assert [is_fresh(each, NOW) for each in marks] == [True, True, False]


def test_east_is_right_and_north_is_up_on_one_scale() -> None:
    circles = drawn(svg_of(BOUNDS, [mark(0, 0), mark(2, 0), mark(0, 2)], [], NOW)).findall("circle")
    (x2, y2), (x1, y1), (x0, y0) = ((float(each.get("cx", "")), float(each.get("cy", ""))) for each in circles)
    assert x1 - x0 == y0 - y2 > 0
    assert (y1, x2) == (y0, x0)


def test_a_zone_is_drawn_where_it_is_below_objects_with_what_is_in_it() -> None:
    zone = Zone(name="<dock>", corners=((0, 0), (4, 0), (4, 3)))
    far, near = drawn(svg_of(BOUNDS, [mark(0, 0), mark(4, 3)], [], NOW)).findall("circle")
    svg = drawn(
        ground_of(BOUNDS, zones=[ZoneCount(zone, {"box": 2}, current=True)], objects=[DrawnObject(thing("a", 1), 0)])
    )
    group = next(each for each in svg if each.get("class") == "zone")
    assert list(svg).index(group) < [each.get("class") for each in svg].index("things age0")
    polygon = group.find("polygon")
    assert polygon is not None
    corners = polygon.get("points", "").split()
    assert (corners[0], corners[2]) == tuple(f"{each.get('cx')},{each.get('cy')}" for each in (near, far))
    assert [each.text for each in group if each.text] == ["<dock>: 2 box", "<dock>"]
    unknown = ground_of(BOUNDS, zones=[ZoneCount(zone, {"box": 2}, current=False)])
    assert "&lt;dock&gt;: not known" in unknown


def test_the_floor_plan_lies_under_everything_where_its_corner_is_and_turned_about_it() -> None:
    plan = FloorPlan(b"", 3.0, 2.0, 1.0, 1.0, 0.5, ())
    svg = drawn(ground_of(BOUNDS, (plan, "/plan.png?a&b")))
    right, corner = drawn(svg_of(BOUNDS, [mark(1, 1), mark(2, 1)], [], NOW)).findall("circle")
    per_m = float(right.get("cx", "")) - float(corner.get("cx", ""))
    group = svg[0]
    assert group.get("transform") == f"translate({corner.get('cx')} {corner.get('cy')}) rotate(-28.65)"
    (image,) = group
    assert image.get("href") == "/plan.png?a&b"
    assert [float(image.get(name, "")) for name in ("y", "width", "height")] == pytest.approx(
        [-2 * per_m, 3 * per_m, 2 * per_m], abs=0.3
    )


def test_a_robot_points_where_it_looks_and_its_name_is_text() -> None:
    name = "<script>alert(1)</script>"
    robot = DrawnRobot(name, Pose(1, 1, 0.5, NOW), live=False)
    text = svg_of(BOUNDS, [mark(name=name)], [robot], NOW)
    assert "<script>" not in text
    (group,) = drawn(text).findall("g")
    assert group.get("class") == "robot lost"
    path, label = group
    assert path.get("transform") == "rotate(-28.6)"
    assert label.text == f"{name}, last seen 0 s ago"


def test_only_of_a_robot_that_is_not_live_it_is_said_when_it_was_seen() -> None:
    poses = [Pose(1, 1, 0, NOW), Pose(2, 2, 0, NOW - 90_999_999_999)]
    robots = [DrawnRobot("here", poses[0], live=True), DrawnRobot("gone", poses[1], live=False)]
    groups = drawn(svg_of(BOUNDS, [], robots, NOW)).findall("g")
    assert [(group.get("class"), group[1].text) for group in groups] == [
        ("robot live", "here"),
        ("robot lost", "gone, last seen 90 s ago"),
    ]


def test_the_picture_is_bounded() -> None:
    far = DrawnRobot("far", Pose(1e8, 0, 0, NOW), live=True)
    text = svg_of(BOUNDS, [mark(x=number % 7) for number in range(3 * MOST_SHOWN)], [far], NOW)
    assert len(re.findall("<circle", text)) == MOST_SHOWN
    assert "far" not in text
    assert len(text) < 150 * MOST_SHOWN
    wide = ground_of(Bounds(-100_000, -100_000, 100_000, 100_000))
    assert len(re.findall("<line", wide)) < 30


def test_classes_have_colours_of_their_own() -> None:
    colours = {colour_of(name) for name in ("box", "pallet", "forklift", "box")}
    assert len(colours) == 3
    assert all(re.fullmatch("#[0-9a-f]{6}", each) for each in colours)
