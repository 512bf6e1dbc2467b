"""Rows of sightings."""

import csv
import io

import pytest
from msgspec.structs import replace

from schemas.keys import CameraKey
from services.monitor.inventory.inventory import Entry
from services.monitor.inventory.sighting import Sighting
from services.monitor.web.api.models import SightingAnswer
from services.monitor.web.pages.rows.sightings import CSV_COLUMNS, Filters, SightingTable, as_csv, sighting_row

S = 1_000_000_000
SIGHTING = Sighting(
    key=CameraKey("r1", "front"),
    name='a, "b"\n<c>',
    count=2,
    score=0.875,
    first_ns=10 * S,
    since_ns=10 * S,
    last_ns=70 * S,
    model="m",
    worker="w",
    nearest_m=1.256,
)


def test_a_sighting_that_is_of_now_was_seen_now() -> None:
    row = sighting_row(Entry(SIGHTING, available=True), 130 * S)
    assert (row["count"], row["score"], row["nearest"]) == (2, "88%", "1.26 m")
    assert (row["first"], row["last"]) == ("2 min ago", "now")


def test_a_sighting_that_is_not_available_was_seen_a_while_ago() -> None:
    row = sighting_row(Entry(SIGHTING, available=False), 130 * S)
    assert (row["available"], row["last"]) == (False, "1 min ago")


def test_the_columns_are_called_as_in_json() -> None:
    fields = {field.serialization_alias or name for name, field in SightingAnswer.model_fields.items()}
    assert set(CSV_COLUMNS) == fields
    odd = replace(SIGHTING, score=0.87654321, nearest_m=2.1213203435)
    _, row = csv.reader(io.StringIO(as_csv([Entry(odd, available=True)])))
    assert row[4:6] == ["0.877", "2.121"]


def test_what_is_downloaded_can_be_read_again_whatever_a_class_is_called() -> None:
    heading, row = csv.reader(io.StringIO(as_csv([Entry(SIGHTING, available=True)])))
    assert tuple(heading) == CSV_COLUMNS
    assert row[:6] == ["r1", "front", 'a, "b"\n<c>', "2", "0.875", "1.256"]


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        *((name, f"'{name}") for name in ("=1+1", "+1", "-1", "@sum(a1)")),
        *((f"{end}=1", f"'{end}'=1") for end in "\t\r\n"),
        *((f"box{end}=1", f"box{end}'=1") for end in (";", "; ", "\t", "\r\n")),
        *((name, name) for name in ("a-b", "box;2", "a=b")),
    ],
)
def test_no_spreadsheet_takes_a_class_a_model_or_a_worker_for_a_formula(name: str, safe: str) -> None:
    odd = replace(SIGHTING, name=name, model=name, worker=name)
    _, row = csv.reader(io.StringIO(as_csv([Entry(odd, available=True)]), newline=""))
    assert [row[place] for place in (2, 9, 10)] == [safe] * 3


def entry(
    robot: str, name: str, count: int, *, available: bool = True, nearest_m: float | None = None, score: float = 0.5
) -> Entry:
    sighting = Sighting(
        key=CameraKey(robot, "front"),
        name=name,
        count=count,
        score=score,
        first_ns=1,
        since_ns=1,
        last_ns=2,
        model="yolo",
        worker="gpu-1",
        nearest_m=nearest_m,
    )
    return Entry(sighting, available)


TABLE = SightingTable([
    entry("r10", "box", 3, nearest_m=1.5),
    entry("r2", "box", 2, available=False),
    entry("r2", "pallet", 9, nearest_m=0.5),
    entry("r3", "person", 0),
    entry("r4", "person", 0, available=False),
])  # fmt: skip


def said(filters: Filters) -> list[str]:
    return [f"{found.sighting.key.robot} {found.sighting.name}" for found in TABLE.wanted(filters)]


def test_only_what_is_in_view_and_known_now_is_counted() -> None:
    assert TABLE.totals == {"pallet": 9, "box": 3}
    assert list(TABLE.totals) == ["pallet", "box"]
    assert TABLE.unknown == 1


def test_it_is_known_how_many_views_are_added_up() -> None:
    table = SightingTable([entry("r1", "box", 3), entry("r2", "box", 2), entry("r3", "box", 2, available=False)])
    assert (table.totals, dict(table.views)) == ({"box": 5}, {"box": 2})


def test_what_was_in_view_before_is_shown_when_asked_for() -> None:
    assert said(Filters()) == ["r2 pallet", "r10 box"]
    assert said(Filters(in_view=False)) == ["r2 box", "r2 pallet", "r3 person", "r4 person", "r10 box"]


def test_robots_and_their_cameras_are_sorted_as_people_count() -> None:
    names = ("r10", "r2", "r1")
    cameras = [(name, camera) for name in names for camera in ("cam10", "cam9")]
    entries = [
        Entry(replace(entry(name, "box", 1).sighting, key=CameraKey(name, camera)), available=True)
        for name, camera in cameras
    ]
    found = SightingTable(entries).wanted(Filters())
    assert [str(each.sighting.key) for each in found[:3]] == ["r1/cam9", "r1/cam10", "r2/cam9"]
    by_camera = SightingTable(entries).wanted(Filters(sort="camera"))
    assert [str(each.sighting.key) for each in by_camera[:2]] == ["r1/cam9", "r2/cam9"]


def test_sightings_are_filtered_by_class_and_text() -> None:
    assert said(Filters(name="box")) == ["r10 box"]
    assert said(Filters(name="box", in_view=False)) == ["r2 box", "r10 box"]
    assert said(Filters(text=" R10")) == ["r10 box"]
    assert said(Filters(text="gpu-1", name="pallet")) == ["r2 pallet"]
    assert said(Filters(text="yolov8")) == []


def test_sightings_are_sorted_by_what_is_asked_for() -> None:
    assert said(Filters(sort="count", descending=True)) == ["r2 pallet", "r10 box"]
    assert said(Filters(sort="nearest", name="box", in_view=False)) == ["r10 box", "r2 box"]
    assert said(Filters(sort="no column")) == said(Filters())
    assert TABLE.wanted(Filters()) is TABLE.wanted(Filters())
