import csv
import io

import pytest
from msgspec.structs import replace

from schemas.keys import CameraKey
from services.monitor.inventory.inventory import Entry
from services.monitor.inventory.sighting import Sighting
from services.monitor.web.api.models import SightingAnswer
from services.monitor.web.pages.rows.inventory import CSV_COLUMNS, as_csv, sighting_row

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


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@sum(a1)", "\t=1", "\r=1", "\n=1"])
def test_no_spreadsheet_takes_a_class_a_model_or_a_worker_for_a_formula(name: str) -> None:
    odd = replace(SIGHTING, name=name, model=name, worker=name)
    _, row = csv.reader(io.StringIO(as_csv([Entry(odd, available=True)]), newline=""))
    assert [row[place] for place in (2, 9, 10)] == [f"'{name}"] * 3
