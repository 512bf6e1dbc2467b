"""Fills the models of the API from the fleet; long lists as JSON without making a model of each item. Pure.

The fields are those of `models`. One that the source has under the same name is taken from there, and the others are
given.
"""

from collections.abc import Sequence
from datetime import datetime
from operator import attrgetter
from typing import Any, Final, TypeVar

import msgspec
from fastapi import Response

from schemas.alerts import Alert
from schemas.status import GatewayStatus
from services.monitor.formats import moment, rounded
from services.monitor.history.intervals import Interval
from services.monitor.history.state import Act
from services.monitor.history.world_history import ObjectEvent, StockLevel
from services.monitor.inventory.inventory import Entry
from services.monitor.map.footprints import address_of_id
from services.monitor.snapshot import CameraLine, RobotLine, WorkerLine
from services.monitor.web.api.models import (
    ActAnswer,
    AlertAnswer,
    CameraAnswer,
    GatewayAnswer,
    IntervalAnswer,
    LoadAnswer,
    Part,
    ReturnAnswer,
    RobotAnswer,
    SightingAnswer,
    StreamAnswer,
    WorkerAnswer,
)
from services.monitor.web.api.world_models import EventAnswer, RobotOffsetAnswer, SiteAnswer, StockAnswer, ZoneAnswer
from services.monitor.world.site_status import KnownSite
from services.monitor.world.zones import ZoneCount

M = TypeVar("M", bound=Part)

Body = dict[str, Any]
"""The JSON of a list's item, in the fields of its model."""


def page_response(now_ns: int, items: Sequence[Body | msgspec.Raw], mark: str | None) -> Response:
    """Return a Page of items, as bodies or already encoded; mark: its `next`."""
    return Response(encoded({"now": moment(now_ns), "items": items, "next": mark}), media_type="application/json")


def encoded(body: Body) -> bytes:
    """Return the JSON of a body."""
    return msgspec.json.encode(body)


def encoded_answer(answer: Part) -> msgspec.Raw:
    """Return the JSON of a model, one item at a time, as a whole page at once takes long."""
    return msgspec.Raw(answer.model_dump_json(by_alias=True).encode())


def known_moment(ns: int) -> datetime | None:
    """Return a time; None for 0, which stands for never."""
    return moment(ns) if ns else None


class _Fields:
    """The fields of a model in JSON, some of them from a source that has them under the same names.

    given: the others, which the caller fills in. Looked up once: there are bodies of thousands of items.
    """

    def __init__(self, model: type[Part], *given: str) -> None:
        fields = {name: field.serialization_alias or name for name, field in model.model_fields.items()}
        taken = [name for name in fields if name not in given]
        self._empty: Body = dict.fromkeys(fields.values())
        self._names = [fields[name] for name in taken]
        self._values = attrgetter(*taken)

    def of(self, source: object) -> Body:
        """Return the fields, those to be filled in as None."""
        return {**self._empty, **dict(zip(self._names, map(rounded, self._values(source)), strict=True))}


def answer_of(model: type[M], source: object, **given: Any) -> M:
    """Return a model. source: has the fields that are not given."""
    names = [name for name in model.model_fields if name not in given]
    return model(**{name: rounded(getattr(source, name)) for name in names}, **given)


_ROBOT: Final = _Fields(RobotAnswer, "last_seen", "waiting_for")
_CAMERA: Final = _Fields(CameraAnswer, "robot", "camera", "last_seen", "age_exact", "classes", "served_by", "dropped")
_SIGHTING: Final = _Fields(SightingAnswer, "robot", "camera", "first_seen", "last_seen", "available")


def robot_body(line: RobotLine) -> Body:
    """Return a RobotAnswer."""
    body = _ROBOT.of(line)
    body["last_seen"] = known_moment(line.last_ns)
    body["waiting_for"] = "" if line.gateway is None else line.gateway.waiting_for
    return body


def camera_body(line: CameraLine) -> Body:
    """Return a CameraAnswer."""
    row = line.row
    body = _CAMERA.of(row)
    body["robot"], body["camera"] = row.key.robot, row.key.camera
    body["last_seen"] = known_moment(line.last_ns)
    body["age_exact"] = row.age is not None and row.age.exact
    if row.classes is not None:
        body["classes"] = [{"name": of.name, "count": of.count, "score": rounded(of.score)} for of in row.classes]
    body["served_by"], body["dropped"] = line.served_by, line.dropped
    return body


def sighting_body(entry: Entry) -> Body:
    """Return a SightingAnswer."""
    of = entry.sighting
    body = _SIGHTING.of(of)
    body["robot"], body["camera"] = of.key.robot, of.key.camera
    body["first_seen"], body["last_seen"] = known_moment(of.first_ns), known_moment(of.last_ns)
    body["available"] = entry.available
    return body


def interval_answer(of: Interval) -> IntervalAnswer:
    """Return an interval's model."""
    times = {"since": moment(of.since_ns), "until": moment(of.until_ns), "first_seen": moment(of.first_ns)}
    return answer_of(IntervalAnswer, of, robot=of.key.robot, camera=of.key.camera, **times)


def alert_answer(alert: Alert, acts: tuple[Act, ...], known_until_ns: int | None) -> AlertAnswer:
    """Return an alert's model. known_until_ns: see `services.monitor.snapshot.known_until_ns`."""
    return answer_of(
        AlertAnswer,
        alert,
        link=address_of_id(alert.site, alert.object) if alert.object else "",
        raised=moment(alert.raised_ns),
        changed=moment(alert.changed_ns),
        known_until=None if known_until_ns is None else moment(known_until_ns),
        acts=tuple(answer_of(ActAnswer, act, at=moment(act.at_ns)) for act in acts),
    )


def worker_answer(line: WorkerLine) -> WorkerAnswer:
    """Return a worker's model."""
    of = line.status
    loads = tuple(LoadAnswer.model_validate(load) for load in of.cameras)
    return answer_of(
        WorkerAnswer,
        of,
        online=line.online,
        last_seen=known_moment(line.last_ns),
        cameras=loads,
        remarks=tuple(of.remarks),
    )


def site_answer(known: KnownSite, now_ns: int) -> SiteAnswer:
    """Return a site's model."""
    of = known.status
    return answer_of(
        SiteAnswer,
        of,
        current=known.is_current(now_ns),
        last_seen=known_moment(known.received_ns),
        objects=dict(of.objects),
        left_out=dict(of.left_out),
        problems=tuple(of.problems),
        robots=tuple(RobotOffsetAnswer.model_validate(each) for each in of.robots),
    )


def zone_answer(counted: ZoneCount) -> ZoneAnswer:
    """Return a zone's model."""
    objects = {name: count for name, count in sorted(counted.objects.items()) if count}
    return answer_of(ZoneAnswer, counted.zone, current=counted.current, objects=objects)


def event_answer(of: ObjectEvent) -> EventAnswer:
    """Return the model of what became of an object."""
    return answer_of(EventAnswer, of, since=moment(of.since_ns), until=moment(of.until_ns))


def stock_answer(of: StockLevel) -> StockAnswer:
    """Return the model of a stock level."""
    return answer_of(StockAnswer, of, since=moment(of.since_ns), until=moment(of.until_ns))


def gateway_answer(of: GatewayStatus, last_ns: int, *, online: bool) -> GatewayAnswer:
    """Return a gateway's model. last_ns: the robot's newest message."""
    return answer_of(
        GatewayAnswer,
        of,
        online=online,
        last_seen=known_moment(last_ns),
        streams=tuple(StreamAnswer.model_validate(stream) for stream in of.streams),
        returns=tuple(ReturnAnswer.model_validate(each) for each in of.returns),
    )
