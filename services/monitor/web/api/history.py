"""Routes about the history: sightings as intervals, alerts, and both as files."""

import asyncio
import time
from collections import defaultdict
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Depends, HTTPException, Query, Request
from fastapi.responses import FileResponse
from pydantic import AwareDatetime, ValidationError
from starlette.background import BackgroundTask

from schemas.alerts import Alert, AlertState
from services.monitor.formats import epoch_ns, moment
from services.monitor.history.archive import AlertCursor, HistoryQuery, SightingCursor, WorldQuery
from services.monitor.history.export import export
from services.monitor.history.intervals import Interval
from services.monitor.history.settings import LAST_NS, NONE, ExportSettings, written_like
from services.monitor.history.state import Act
from services.monitor.monitor import Monitor
from services.monitor.web.api.bodies import alert_answer, event_answer, interval_answer, stock_answer
from services.monitor.web.api.models import AlertAnswer, IntervalAnswer, Page
from services.monitor.web.api.paging import After, ClassName, Limit, Name, first_of, operator_of, place_of
from services.monitor.web.api.world_models import EventAnswer, StockAnswer

DEFAULT_LIMIT: Final = 200
DAY_NS: Final = 86_400 * 1_000_000_000

KINDS: Final = {"csv": "text/csv", "parquet": "application/vnd.apache.parquet"}
FILES: Final[dict[int | str, dict[str, Any]]] = {200: {"content": {kind: {} for kind in KINDS.values()}}}

Moment = Annotated[AwareDatetime, written_like("2026-11-20T06:00Z")]
Since = Annotated[Moment | None, Query(description="skip what ended before this time; a day ago by default")]
Site = Annotated[str, Query(max_length=64, description="only in this site")]
ZoneName = Annotated[str, Query(max_length=64, description="only in this zone")]
Until = Annotated[Moment | None, Query(description="skip what began after this time")]


def period(*, since: Since = None, until: Until = None) -> tuple[int, int]:
    """Return the beginning and the end of the time that a URL is about, epoch nanoseconds.

    Raises:
        HTTPException: it ends before it begins.
    """
    since_ns = time.time_ns() - DAY_NS if since is None else _bounded_ns(since)
    until_ns = 2**63 - 1 if until is None else _bounded_ns(until)
    if since_ns > until_ns:
        raise HTTPException(422, "since is later than until" if since else "since, a day ago, is later than until")
    return since_ns, until_ns


Period = Annotated[tuple[int, int], Depends(period)]


def asked(during: Period, *, robot: Name = "", camera: Name = "", name: ClassName = "") -> HistoryQuery:
    """Return the history query of a URL."""
    return HistoryQuery(*during, robot=robot, camera=camera, name=name)


FromQuery = Annotated[HistoryQuery, Depends(asked)]


def history_routes(monitor: Monitor) -> APIRouter:
    """Return the routes."""
    router = APIRouter(prefix="/history", tags=["history"])
    exporting = asyncio.Lock()

    @router.get("/sightings")
    async def sightings(wanted: FromQuery, limit: Limit = DEFAULT_LIMIT, after: After = None) -> Page[IntervalAnswer]:
        """The objects in view, one interval per constant count; newest first."""
        place = None if after is None else place_of(after, (int, str, str, str))
        items, mark = first_of(await monitor.archive.sightings(wanted, limit + 1, place), _interval_place, limit)
        return Page(now=moment(time.time_ns()), items=[interval_answer(each) for each in items], next=mark)

    @router.get("/alerts")
    async def alerts(
        wanted: FromQuery,
        state: Annotated[AlertState | None, Query(description="only alerts in this state")] = None,
        limit: Limit = DEFAULT_LIMIT,
        after: After = None,
    ) -> Page[AlertAnswer]:
        """Alerts, resolved or not, with operators' actions on them; last changed first."""
        place = None if after is None else place_of(after, (int, str))
        states = () if state is None else (state,)
        found = await monitor.archive.alerts(wanted, limit + 1, place, states=states)
        items, mark = first_of(found, _alert_place, limit)
        acts = await monitor.archive.acts([alert.id for alert in items])
        done: dict[str, list[Act]] = defaultdict(list)
        for act in acts:
            done[act.alert_id].append(act)
        answers = [alert_answer(each, tuple(done[each.id]), monitor.known_until_ns(each)) for each in items]
        return Page(now=moment(time.time_ns()), items=answers, next=mark)

    @router.get("/events")
    async def events(
        during: Period,
        site: Site = "",
        object_id: Annotated[str, Query(alias="object", max_length=64, description="only of this object")] = "",
        name: ClassName = "",
        *,
        limit: Limit = DEFAULT_LIMIT,
        after: After = None,
    ) -> Page[EventAnswer]:
        """Events of sites' objects, newest first: appeared, moved, gone, back, merged."""
        place = None if after is None else place_of(after, (int, str, str, str))
        query = WorldQuery(*during, site=site, object=object_id, name=name)
        found = await monitor.archive.object_events(query, limit + 1, place)
        items, mark = first_of(found, lambda of: (of.until_ns, of.site, of.object, of.kind), limit)
        return Page(now=moment(time.time_ns()), items=[event_answer(each) for each in items], next=mark)

    @router.get("/stock")
    async def levels(
        during: Period,
        site: Site = "",
        zone: Annotated[str | None, Query(max_length=64, description="only this zone; empty: whole sites")] = None,
        name: ClassName = "",
        *,
        limit: Limit = DEFAULT_LIMIT,
        after: After = None,
    ) -> Page[StockAnswer]:
        """How many objects of a class a zone, or a whole site, held; one interval per constant number, newest first."""
        place = None if after is None else place_of(after, (int, str, str, str))
        query = WorldQuery(*during, site=site, name=name, zone=zone)
        found = await monitor.archive.stock(query, limit + 1, place)
        items, mark = first_of(found, lambda of: (of.since_ns, of.site, of.zone, of.name), limit)
        return Page(now=moment(time.time_ns()), items=[stock_answer(each) for each in items], next=mark)

    @router.get("/export", response_class=FileResponse, responses=FILES)
    async def whole(
        wanted: FromQuery,
        what: Literal["sightings", "alerts", "stock", "events"] = "sightings",
        kind: Annotated[Literal["csv", "parquet"], Query(alias="format")] = "csv",
        *,
        site: Site = "",
        zone: ZoneName = "",
        bom: Annotated[bool, Query(description="begin CSV with a byte order mark, as Excel needs it")] = False,
    ) -> FileResponse:
        """All matching sightings, alerts, stock or events as a file, oldest first; one export runs at a time."""
        if exporting.locked():
            raise HTTPException(503, "another export is running; try again later", {"Retry-After": "10"})
        async with exporting:
            folder = await asyncio.to_thread(TemporaryDirectory, prefix="fleetsight-")
            file = Path(folder.name) / f"{what}.{kind}"
            try:
                settings = _export_settings(monitor.settings.history, wanted, file, what=what, site=site, zone=zone)
                await export(settings.model_copy(update={"bom": bom}))
            except BaseException:
                await asyncio.to_thread(folder.cleanup)
                raise
        return FileResponse(file, media_type=KINDS[kind], filename=file.name, background=BackgroundTask(folder.cleanup))

    @router.post("/trust-clock", status_code=204)
    async def trust_clock(request: Request) -> None:
        """Trust the clock of the monitor's machine, however long ago the history was written last."""
        monitor.trust_clock(operator_of(request, monitor))

    return router


def _interval_place(of: Interval) -> SightingCursor:
    return of.since_ns, of.key.robot, of.key.camera, of.name


def _alert_place(alert: Alert) -> AlertCursor:
    return alert.changed_ns, alert.id


def _export_settings(history: str, wanted: HistoryQuery, file: Path, **more: str) -> ExportSettings:
    if history == NONE:
        raise HTTPException(503, "no history is kept: the monitor was started with --history none")
    given: dict[str, Any] = {"task": "export", "to": file, "history": history, **more}
    given |= {"since": moment(min(wanted.since_ns, LAST_NS)), "until": moment(min(wanted.until_ns, LAST_NS))}
    given |= {"robot": wanted.robot, "camera": wanted.camera, "class": wanted.name}
    try:
        return ExportSettings(**given)
    except ValidationError as error:
        reason = error.errors()[0]["msg"].removeprefix("Value error, ").replace("--", "")  # parameters have no dashes
        raise HTTPException(422, reason) from error


def _bounded_ns(at: datetime) -> int:
    return min(max(0, epoch_ns(at)), 2**63 - 1)
