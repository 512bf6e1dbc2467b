"""Where each millisecond goes: one image's way from hop to hop, each beside what it cannot be quicker than. Pure."""

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from schemas.keys import Stream

MS: Final = 1e-6
OVERLAYS: Final = (Stream.OVERLAY_DETECTION, Stream.OVERLAY_SEGMENTATION)


@dataclass(slots=True)
class Seen:
    """What was seen of one image. Times are nanoseconds since the epoch.

    at_ns: when its message of each stream came; sizes: their bytes. spans: what the messages say themselves.
    told_ns: when the monitor said that it knows. returned_ns: when its overlay was back on ROS.
    """

    stamp_ns: int
    received_ns: int = 0
    at_ns: dict[Stream, int] = field(default_factory=dict)
    sizes: dict[Stream, int] = field(default_factory=dict)
    spans: dict[str, int] = field(default_factory=dict)
    told_ns: int | None = None
    returned_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Limit:
    """What a hop cannot be quicker than."""

    what: str
    ms: float


def span(name: str) -> Callable[[Seen], int | None]:
    """Return what reads a span."""
    return lambda seen: seen.spans.get(name)


def _between(begun: int | None, ended: int | None) -> int | None:
    return None if begun is None or ended is None else ended - begun


def _results(seen: Seen) -> int | None:
    """What is left of the way from the image to its detections: what no span tells of."""
    whole = _between(seen.at_ns.get(Stream.COLOR), seen.at_ns.get(Stream.DETECTIONS))
    inside = ("queue", "prepare", "model", "postprocess", "track")
    return None if whole is None else max(0, whole - sum(seen.spans.get(name, 0) for name in inside))


def _drawn(seen: Seen) -> int | None:
    ends = [seen.at_ns[stream] for stream in OVERLAYS if stream in seen.at_ns]
    return _between(seen.at_ns.get(Stream.DETECTIONS), max(ends, default=None))


HOPS: Final[Mapping[str, Callable[[Seen], int | None]]] = {
    "camera": lambda seen: _between(seen.stamp_ns, seen.received_ns or None),
    "gateway and link": lambda seen: _between(seen.received_ns or None, seen.at_ns.get(Stream.COLOR)),
    "queue": span("queue"),
    "pre-processing": span("prepare"),
    "model": span("model"),
    "post-processing": span("postprocess"),
    "tracking": span("track"),
    "results": _results,
    "overlays": _drawn,
    "distance": span("distance"),
    "cloud": span("cloud"),
    "return to ROS": lambda seen: _between(seen.at_ns.get(Stream.OVERLAY_SEGMENTATION), seen.returned_ns),
    "monitor": lambda seen: _between(seen.at_ns.get(Stream.CLASSES), seen.told_ns),
}


NO_LIMIT: Final = {
    "queue": "no limit: a frame that comes alone need not wait",
    "tracking": "no limit: nothing else that does it stands beside it",
}
"""Why there is nothing beside a hop."""


def table(frames: Sequence[Seen], link_ms: float, limits: Mapping[str, Limit]) -> list[dict[str, Any]]:
    """Return a row for each hop: the median of the images, its limit, and how many times that it takes.

    link_ms: what the bare link takes of "gateway and link", which become two.
    """
    found: dict[str, float | None] = {}
    for name, read in HOPS.items():
        values = [value for frame in frames if (value := read(frame)) is not None]
        ms = statistics.median(values) * MS if values else None
        if name == "gateway and link":
            found["gateway"] = None if ms is None else max(0.0, ms - link_ms)
            found["link"] = link_ms
        else:
            found[name] = ms
    return [_row(name, ms, limits.get(name)) for name, ms in found.items()]


def _row(name: str, ms: float | None, limit: Limit | None) -> dict[str, Any]:
    return {
        "hop": name,
        "ms": None if ms is None else round(ms, 3),
        "limit": NO_LIMIT.get(name) if limit is None else limit.what,
        "limit_ms": None if limit is None else round(limit.ms, 3),
        "ratio": None if limit is None or ms is None or not limit.ms else round(ms / limit.ms, 2),
    }


def lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the table as text."""
    head = f"{'hop':16} {'ms':>9} {'limit':>9} {'ratio':>7}  of"
    return [head, *(_line(row) for row in rows)]


def _line(row: Mapping[str, Any]) -> str:
    numbers = [f"{'-' if row[name] is None else row[name]:>{width}}" for name, width in COLUMNS.items()]
    return f"{row['hop']:16} {' '.join(numbers)}  {row['limit'] or '-'}"


COLUMNS: Final = {"ms": 9, "limit_ms": 9, "ratio": 7}
