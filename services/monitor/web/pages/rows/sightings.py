"""The sightings in view of cameras as a table with search, sorting and counts. Pure."""

import csv
import io
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final

from services.monitor.formats import as_text, natural, natural_camera, rounded
from services.monitor.inventory.inventory import Entry
from services.monitor.web.pages.rows.formatting import NOTHING, WHEN, ago, iso

CSV_COLUMNS: Final = (
    "robot", "camera", "class", "count", "score", "nearest_m", "first_seen", "last_seen", "available", "model",
    "worker",
)  # fmt: skip


def sighting_row(entry: Entry, now_ns: int) -> dict[str, Any]:
    """Return a sighting as a row of the templates."""
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
    """Return sightings as CSV with a heading; times are UTC, and formulas are escaped."""
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


CHOOSE: Final = "$parent.$emit('choose', [props.row.robot, props.row.camera, props.row.name])"

LIVE_VIEW: Final = """<a class="fs-link"
  :href="'/cameras/' + encodeURIComponent(props.row.robot) + '/' + encodeURIComponent(props.row.camera)"
  >{{ props.row.camera }}</a>"""

SIGHTING_BODY: Final = f"""
<q-tr :props="props" :class="props.row.available ? '' : 'fs-stale'" :data-sighting="props.row.id">
  <q-td key="robot" :props="props" class="fs-name">{{{{ props.row.robot }}}}</q-td>
  <q-td key="camera" :props="props" class="fs-where">{LIVE_VIEW}</q-td>
  <q-td key="name" :props="props" class="fs-wide"><button class="fs-link" title="over time" @click="{CHOOSE}"
    >{{{{ props.row.name }}}}</button></q-td>
  <q-td key="count" :props="props"><b>{{{{ props.row.count }}}}</b></q-td>
  <q-td key="score" :props="props">{{{{ props.row.score }}}}</q-td>
  <q-td key="nearest" :props="props">{{{{ props.row.nearest }}}}</q-td>
  <q-td key="first" :props="props" {WHEN.format(at="props.row.first_at")}>{{{{ props.row.first }}}}</q-td>
  <q-td key="last" :props="props" {WHEN.format(at="props.row.last_at")}>{{{{ props.row.last }}}}</q-td>
  <q-td key="worker" :props="props" class="fs-wide"
    >{{{{ props.row.worker }}}} <span class="fs-muted">{{{{ props.row.model }}}}</span></q-td>
</q-tr>
"""

SIGHTING_CARD: Final = f"""
<div :class="props.row.available ? 'fs-card' : 'fs-card fs-stale'" :data-sighting="props.row.id">
  <div class="fs-top"><span><button class="fs-chip" @click="{CHOOSE}"><b>{{{{ props.row.count }}}}</b
    >{{{{ props.row.name }}}}</button></span><span class="fs-small">{{{{ props.row.nearest }}}}</span></div>
  <div class="fs-top"><span><strong>{{{{ props.row.robot }}}}</strong> {LIVE_VIEW}</span
    ><span class="fs-muted fs-small">{{{{ props.row.last }}}}</span></div>
  <div class="fs-muted fs-small">{{{{ props.row.score }}}}, first seen {{{{ props.row.first }}}},
    {{{{ props.row.worker }}}} {{{{ props.row.model }}}}</div>
</div>
"""


@dataclass(frozen=True, slots=True)
class Filters:
    """Selects sightings: `text` is in one of their names.

    in_view: only what is known to be in view now, so nothing that a silent or offline robot saw.
    """

    text: str = ""
    name: str = ""
    in_view: bool = True
    sort: str = "robot"
    descending: bool = False


SORTS: Final[Mapping[str, Callable[[Entry], Any]]] = {
    "robot": lambda entry: natural_camera(entry.sighting.key),
    "camera": lambda entry: natural_camera(entry.sighting.key)[::-1],
    "name": lambda entry: natural(entry.sighting.name),
    "count": attrgetter("sighting.count"),
    "score": attrgetter("sighting.score"),
    "first": attrgetter("sighting.first_ns"),
    "last": attrgetter("sighting.last_ns"),
    "nearest": lambda entry: float("inf") if entry.sighting.nearest_m is None else entry.sighting.nearest_m,
}


class SightingTable:
    """All sightings at one moment. Results are cached, as many viewers ask for the same.

    totals: how many objects of each class are in view where that is known now, the most first. It is a sum over the
    views of cameras: an object that two of them see counts twice. views: how many cameras have each class in view.
    unknown: sightings that went on when their cameras fell silent, or their robots went.
    """

    def __init__(self, entries: Sequence[Entry]) -> None:
        self.entries = entries
        self._kept: dict[Filters, Sequence[Entry]] = {}
        self.unknown = sum(entry.sighting.count > 0 and not entry.available for entry in entries)
        totals, self.views = Counter[str](), Counter[str]()
        for entry in entries:
            if is_in_view(entry):
                totals[entry.sighting.name] += entry.sighting.count
                self.views[entry.sighting.name] += 1
        self.totals: Mapping[str, int] = dict(totals.most_common())

    def wanted(self, filters: Filters) -> Sequence[Entry]:
        """Return the selected sightings in the given order."""
        if filters not in self._kept:
            text = filters.text.strip().casefold()
            found = [entry for entry in self.entries if _is_wanted(entry, filters, text)]
            key = SORTS.get(filters.sort, SORTS["robot"])
            self._kept[filters] = sorted(found, key=key, reverse=filters.descending)
        return self._kept[filters]


def is_in_view(entry: Entry) -> bool:
    """Whether any are in view, as far as is known now."""
    return entry.available and entry.sighting.count > 0


def _is_wanted(entry: Entry, filters: Filters, text: str) -> bool:
    of = entry.sighting
    if filters.in_view and not is_in_view(entry):
        return False
    if filters.name not in ("", of.name):
        return False
    return not text or any(
        text in each.casefold() for each in (of.key.robot, of.key.camera, of.name, of.model, of.worker)
    )
