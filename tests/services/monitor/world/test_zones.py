from pathlib import Path

import pytest

from services.monitor.world.zones import MAX_ZONES, ZoneFileError, ZoneFinder, load_zones, parse_zones

ZONES = """\
zones:
  - name: dock 1
    corners: [[0, 0], [4, 0], [4, 3], [0, 3]]
  - name: aisle
    site: hall-2
    corners:
      - [0, 0]
      - [10, 0]
      - [10, 10]
      - [8, 10]
      - [8, 2]
      - [0, 2]
"""


def one(corners: str, name: str = "dock") -> str:
    return f"zones:\n  - name: {name}\n    corners: {corners}\n"


def test_zones_have_a_name_a_site_and_corners() -> None:
    dock, aisle = parse_zones(ZONES)
    assert (dock.name, dock.site, dock.corners[2]) == ("dock 1", "main", (4.0, 3.0))
    assert (aisle.name, aisle.site, len(aisle.corners)) == ("aisle", "hall-2", 6)
    assert parse_zones("zones: []") == ()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1: `zones` is missing; to have no zones, write `zones: []`"),
        ("- dock", "line 1: `zones` is missing"),
        ("zones: {a: b", "line 1: "),
        (one("[[0, 0], [4, 0]]"), "line 3: zone 'dock': corners: 2 corners: a zone needs at least 3"),
        (one("[]"), "0 corners"),
        (one("[[0, 0], [4, 4], [4, 0], [0, 4]]"), "its side [0, 0] to [4, 4] meets its side [4, 0] to [0, 4]"),
        (one("[[0, 0], [4, 0], [2, 0]]"), "line 3: zone 'dock': corners: its side"),
        (one("[[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]]"), "meets its side"),
        (one("[[0, 0], [4, 0], [0, 0], [0, 4]]"), "corner [0, 0] is given twice"),
        (one("[[0, 0], [4, 0], [4, 1e9]]"), "[4, 1e+09] is more than 100,000 m from the map's origin"),
        (one("[[0, 0], [4, .nan], [4, 4]]"), "finite"),
        (one("dock"), "write it as a list, like [[0, 0], [4, 0], [4, 3]]"),
        (one("[[0, 0], [4, 0], [4, 4]]", name='""'), "zone 1: name"),
        ("zones:\n  - name: a\n", "line 2: zone 'a': corners: is missing"),
        ("zones:\n  - corners: [[0, 0], [4, 0], [4, 3]]\n", "zone 1: name: is missing"),
        ("zones:\n  - name: a\n    corner: []\n", "line 3: zone 'a': corner: is not a known key"),
        ("zones:\n  - name: a\n    site: b/c\n    corners: [[0, 0], [4, 0], [4, 3]]\n", "line 3: zone 'a': site"),
        (ZONES.replace("aisle", "dock 1").replace("hall-2", "main"), "line 4: zone 'dock 1': name: two zones of site"),
        (
            "zones:\n" + "  - {name: a, corners: [[0, 0], [4, 0], [4, 3]]}\n" * (MAX_ZONES + 1),
            f"line 1: zones: {MAX_ZONES + 1} are given; there may be {MAX_ZONES} at most",
        ),
    ],
)
def test_a_mistake_is_told_with_line_zone_and_cure(text: str, says: str) -> None:
    with pytest.raises(ZoneFileError) as caught:
        parse_zones(text)
    assert says in str(caught.value)


def test_two_sites_may_have_zones_of_one_name() -> None:
    assert len(parse_zones(ZONES.replace("aisle", "dock 1"))) == 2


def test_a_file_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    missing, wrong = tmp_path / "missing.yaml", tmp_path / "wrong.yaml"
    wrong.write_text(one("[[0, 0], [4, 0]]"))
    with pytest.raises(ZoneFileError, match=r"missing\.yaml: No such file"):
        load_zones(missing)
    with pytest.raises(ZoneFileError, match=r"wrong\.yaml: line 3: zone 'dock'"):
        load_zones(wrong)


def test_a_point_is_in_every_zone_around_it() -> None:
    dock, aisle = parse_zones(ZONES)
    finder = ZoneFinder([dock, aisle])
    assert finder.at(1, 1) == ("dock 1", "aisle")
    assert finder.at(3, 2.5) == ("dock 1",)
    assert finder.at(9, 9) == ("aisle",)
    assert finder.at(5, 5) == finder.at(-1, 1) == ()
