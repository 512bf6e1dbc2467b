"""The chart of counts in view over time."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from nicegui import ui

from services.monitor.event_loop.cached_value import CachedValue
from services.monitor.history.archive import Archive, HistoryQuery, WorldQuery
from services.monitor.history.counting import Counts
from services.monitor.history.state import HistoryError
from services.monitor.web.pages.rows.formatting import NS
from services.monitor.world.site_objects import SITE

MAX_LINES: Final = 8
"""Maximum number of classes in one chart; those with the highest counts are shown."""

Points = list[tuple[int, int | None]]
"""(milliseconds since the epoch, count), oldest first; a count lasts until the next. None: unknown."""


def counts_over_time(counts: Counts) -> dict[str, Points]:
    """Return the points of each class, summed over cameras, the class with the highest counts first."""
    biggest = sorted(counts.most, key=lambda name: (-max(counts.most[name].values(), default=0), name))
    return {name: list(_points(counts, counts.most[name])) for name in biggest[:MAX_LINES]}


def _points(counts: Counts, most: Mapping[int, int]) -> Iterator[tuple[int, int | None]]:
    """Yield a point wherever the count changes, or is not known any more, and one for the end."""
    slots, before, number = counts.slots, object(), counts.slots.number
    for slot in range(number):
        count = most.get(slot, 0) if slot in counts.known else None
        if count != before:
            yield (slots.since_ns + slot * slots.width_ns) * 1_000 // NS, count
        before = count
    yield slots.until_ns * 1_000 // NS, most.get(number - 1, 0) if number - 1 in counts.known else None


RANGES: Final = {"1 h": 3_600, "6 h": 21_600, "24 h": 86_400, "7 d": 604_800, "30 d": 2_592_000, "1 y": 31_536_000}
MAX_AGE_S: Final = 10.0
MAX_KEPT: Final = 32
"""Maximum number of charts cached for other viewers."""

COLORS: Final = ("#3b7ddd", "#e08a2e", "#2fa36b", "#c94f7c", "#8a63d2", "#1aa3b8", "#b5892b", "#7a8794")


@dataclass(frozen=True, slots=True)
class Subject:
    """The subject of a chart: one robot, camera or class, each all of them if empty, over the last seconds.

    text: what is in one of their names, as it is searched for.
    """

    robot: str = ""
    camera: str = ""
    name: str = ""
    seconds: int = 3_600
    text: str = ""

    def __str__(self) -> str:
        """Return the subject in words."""
        where = "/".join(part for part in (self.robot, self.camera) if part)
        like = f", with {self.text} in a name" if self.text else ""
        return f"{self.name or 'all classes'}, {where or 'whole fleet'}{like}"


@dataclass(frozen=True, slots=True)
class StockSubject:
    """The subject of a chart of stock: a zone of a site, or all of it, and a class or all, over the last seconds."""

    site: str
    zone: str = SITE
    name: str = ""
    seconds: int = 3_600


@dataclass(frozen=True, slots=True)
class Drawn:
    """Points of each class, or in words why there are none."""

    lines: Mapping[str, Points]
    since_ns: int
    until_ns: int
    problem: str = ""


class Charts:
    """Charts of an archive, each read once for all viewers."""

    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._kept: dict[Subject | StockSubject, CachedValue[Drawn]] = {}

    async def of(self, subject: Subject | StockSubject) -> Drawn:
        """Return a chart that is no older than MAX_AGE_S."""
        kept = self._kept.pop(subject, None) or CachedValue(lambda: self._draw(subject), MAX_AGE_S)
        self._kept[subject] = kept
        while len(self._kept) > MAX_KEPT:
            del self._kept[next(iter(self._kept))]
        return await kept.get()

    async def _draw(self, subject: Subject | StockSubject) -> Drawn:
        until_ns = time.time_ns()
        since_ns = until_ns - subject.seconds * NS
        try:
            counts = await self._count(subject, since_ns, until_ns)
        except HistoryError as error:
            return Drawn({}, since_ns, until_ns, problem=str(error))
        return Drawn(counts_over_time(counts), since_ns, until_ns)

    async def _count(self, subject: Subject | StockSubject, since_ns: int, until_ns: int) -> Counts:
        if isinstance(subject, StockSubject):
            asked = WorldQuery(since_ns, until_ns, site=subject.site, name=subject.name, zone=subject.zone)
            return await self._archive.stock_counts(asked)
        return await self._archive.counts(
            HistoryQuery(since_ns, until_ns, subject.robot, subject.camera, subject.name, subject.text)
        )


def chart() -> ui.echart:
    """Make an empty chart."""
    return ui.echart({"series": []}).classes("fs-chart")


def show_chart(element: ui.echart, why_not: ui.label, drawn: Drawn, nothing: str) -> None:
    """Show a chart, or why there is none. nothing: what is said of one without lines."""
    reason = drawn.problem or ("" if drawn.lines else nothing)
    why_not.set_text(reason)
    why_not.set_visibility(bool(reason))
    element.set_visibility(not reason)
    element.options.clear()
    element.options.update(options(drawn))


def options(drawn: Drawn) -> dict[str, Any]:
    """Return ECharts options, with colours for light and dark pages."""
    line = "#8894a040"
    label = {"color": "#7d8a97", "fontSize": 12}
    return {
        "animation": False,
        "color": list(COLORS),
        "grid": {"left": 40, "right": 16, "top": 30, "bottom": 24},
        "legend": {"type": "scroll", "top": 0, "left": 0, "icon": "roundRect", "textStyle": label},
        "tooltip": {"trigger": "axis", "renderMode": "richText"},
        "xAxis": {
            "type": "time",
            "min": drawn.since_ns * 1_000 // NS,
            "max": drawn.until_ns * 1_000 // NS,
            "axisLabel": {**label, "hideOverlap": True},
            "axisLine": {"lineStyle": {"color": line}},
        },
        "yAxis": {
            "type": "value",
            "minInterval": 1,
            "axisLabel": label,
            "splitLine": {"lineStyle": {"color": line}},
        },
        "series": [
            {
                "name": name,
                "type": "line",
                "step": "end",
                "showSymbol": False,
                "lineStyle": {"width": 2},
                "areaStyle": {"opacity": 0.08},
                "data": [list(point) for point in points],
            }
            for name, points in drawn.lines.items()
        ],
    }
