"""JSON of long lists, in the fields of `models`, mostly without making models.

Pure.
"""

from collections.abc import Sequence
from typing import Any

import msgspec
from fastapi import Response

from services.monitor.formats import moment, rounded
from services.monitor.inventory.inventory import Entry
from services.monitor.snapshot import CameraLine, RobotLine
from services.monitor.web.api.models import Part, known_moment

Body = dict[str, Any]
"""The JSON of a list's item, in the fields of its model in `models`."""


def page_response(now_ns: int, items: Sequence[Body | msgspec.Raw], mark: str | None) -> Response:
    """Return a Page of items, as bodies or already encoded; mark: its `next`."""
    return Response(encoded({"now": moment(now_ns), "items": items, "next": mark}), media_type="application/json")


def encoded(body: Body) -> bytes:
    """Return the JSON of a body."""
    return msgspec.json.encode(body)


def encoded_answer(answer: Part) -> msgspec.Raw:
    """Return the JSON of a model, one item at a time, as a whole page at once takes long."""
    return msgspec.Raw(answer.model_dump_json(by_alias=True).encode())


def robot_body(line: RobotLine) -> Body:
    """Return a RobotAnswer."""
    return {
        "name": line.name,
        "online": line.online,
        "last_seen": known_moment(line.last_ns),
        "cameras": line.cameras,
        "age_s": rounded(line.age_s),
        "rate_hz": rounded(line.rate_hz),
        "waiting_for": "" if line.gateway is None else line.gateway.waiting_for,
        "problems": line.problems,
        "dropped": line.dropped,
    }


def camera_body(line: CameraLine) -> Body:
    """Return a CameraAnswer."""
    row = line.row
    seen = row.classes
    return {
        "robot": row.key.robot,
        "camera": row.key.camera,
        "online": row.online,
        "stale": row.stale,
        "last_seen": known_moment(line.last_ns),
        "age_s": None if row.age is None else rounded(row.age.seconds),
        "age_exact": row.age is not None and row.age.exact,
        "rate_hz": rounded(row.rate_hz),
        "classes": None
        if seen is None
        else [{"name": of.name, "count": of.count, "score": rounded(of.score)} for of in seen],
        "served_by": line.served_by,
        "dropped": line.dropped,
    }


def sighting_body(entry: Entry) -> Body:
    """Return a SightingAnswer."""
    of = entry.sighting
    return {
        "robot": of.key.robot,
        "camera": of.key.camera,
        "class": of.name,
        "count": of.count,
        "score": rounded(of.score),
        "first_seen": known_moment(of.first_ns),
        "last_seen": known_moment(of.last_ns),
        "nearest_m": rounded(of.nearest_m),
        "model": of.model,
        "worker": of.worker,
        "available": entry.available,
    }
