"""Sightings as rows of the inventory's table, and as CSV. Pure."""

import csv
import io
from collections.abc import Iterable
from typing import Any, Final

from services.monitor.export.writing import as_text
from services.monitor.figures import rounded
from services.monitor.inventory.inventory import Entry
from services.monitor.page.formatting import NOTHING, ago, iso

CSV_COLUMNS: Final = (
    "robot", "camera", "class", "count", "score", "nearest_m", "first_seen", "last_seen", "available", "model",
    "worker",
)  # fmt: skip


def sighting_row(entry: Entry, now_ns: int) -> dict[str, Any]:
    """Return a sighting as the inventory's templates take it."""
    of = entry.sighting
    return {
        "id": f"{of.key}/{of.name}",
        "robot": of.key.robot,
        "camera": of.key.camera,
        "name": of.name,
        "count": of.count,
        "available": entry.available,
        "score": f"{of.score:.0%}",
        "first": ago(of.first_ns, now_ns),
        "first_at": iso(of.first_ns),
        "last": "now" if entry.available and of.count else ago(of.last_ns, now_ns),
        "last_at": iso(of.last_ns),
        "nearest": NOTHING if of.nearest_m is None else f"{of.nearest_m:.2f} m",
        "worker": of.worker,
        "model": of.model,
    }


def as_csv(entries: Iterable[Entry]) -> str:
    """Return sightings as CSV with a heading; times are UTC, and no text is a spreadsheet's formula."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(CSV_COLUMNS)
    for entry in entries:
        of = entry.sighting
        cells = (
            of.key.robot, of.key.camera, of.name, of.count, rounded(of.score), rounded(of.nearest_m), iso(of.first_ns),
            iso(of.last_ns), entry.available, of.model, of.worker,
        )  # fmt: skip
        writer.writerow(map(as_text, cells))
    return text.getvalue()
