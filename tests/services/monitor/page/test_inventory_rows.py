import csv
import io

from schemas.keys import CameraKey
from services.monitor.inventory.inventory import Entry
from services.monitor.inventory.sighting import Sighting
from services.monitor.page.inventory_rows import CSV_COLUMNS, as_csv, sighting_row

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


def test_what_is_downloaded_can_be_read_again_whatever_a_class_is_called() -> None:
    heading, row = csv.reader(io.StringIO(as_csv([Entry(SIGHTING, available=True)])))
    assert tuple(heading) == CSV_COLUMNS
    assert row[:6] == ["r1", "front", 'a, "b"\n<c>', "2", "0.875", "1.256"]
