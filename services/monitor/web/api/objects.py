"""Routes about the objects of sites: pages of them, one of them, and all of them as a file."""

import asyncio
import csv
import heapq
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Depends, HTTPException, Query, Response
from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.fleet import Fleet
from services.monitor.formats import as_text, moment, rounded
from services.monitor.monitor import Monitor
from services.monitor.web.api.bodies import Body, encoded_answer, known_moment, page_response
from services.monitor.web.api.history import FILES, KINDS
from services.monitor.web.api.models import Page
from services.monitor.web.api.paging import After, ClassName, Limit, Name, first_of, place_of
from services.monitor.web.api.world_models import ObjectAnswer, SeerAnswer
from services.monitor.world.selection import ObjectFilters
from services.monitor.world.site_objects import PlacedObject, World
from services.monitor.world.site_status import Sites

DEFAULT_LIMIT: Final = 200
NS: Final = 1_000_000_000
FARTHEST_S: Final = 1e9

Seconds = Annotated[float | None, Query(ge=0, le=FARTHEST_S)]

COLUMNS: Final = (
    "site", "id", "class", "x", "y", "z", "sigma_m", "length", "width", "height", "yaw", "zones", "existence",
    "first_seen", "last_seen", "looked_in_vain", "robot", "camera", "sightings", "velocity_x", "velocity_y", "current",
)  # fmt: skip
TIMES: Final = ("first_seen", "last_seen", "looked_in_vain")
TEXTS: Final = ("site", "id", "class", "zones", "robot", "camera")


@dataclass(frozen=True, slots=True)
class ObjectQuery:
    """A query for objects. site: of this one alone, if named."""

    site: str
    filters: ObjectFilters


def asked(
    *,
    site: Name = "",
    name: ClassName = "",
    zone: Annotated[str, Query(max_length=64, description="only in this zone")] = "",
    robot: Annotated[str, Query(max_length=64, description="only what this robot is among the last to have seen")] = "",
    seen_within_s: Seconds = None,
    unseen_for_s: Seconds = None,
) -> ObjectQuery:
    """Return the query of a URL."""
    now_ns = time.time_ns()
    since_ns, until_ns = (None if each is None else now_ns - round(each * NS) for each in (seen_within_s, unseen_for_s))
    return ObjectQuery(site, ObjectFilters(name, zone, robot, since_ns, until_ns))


FromQuery = Annotated[ObjectQuery, Depends(asked)]


@dataclass(frozen=True, slots=True)
class FoundObject:
    """An object of a site, and whether it is known as of now."""

    site: str
    placed: PlacedObject
    current: bool


async def first_objects(
    fleet: Fleet, wanted: ObjectQuery, most: int, after: tuple[str, str] | None = None
) -> list[FoundObject]:
    """Return the first objects by site and id, at most so many; after the place where another page ended."""
    return await asyncio.to_thread(_first, fleet.world, fleet.sites, wanted, most, after)


def _first(
    world: World, sites: Sites, wanted: ObjectQuery, most: int, after: tuple[str, str] | None
) -> list[FoundObject]:
    """Choose in another thread, as there may be hundred thousands; each site's objects are copied in one step."""
    now_ns = time.time_ns()
    found: list[FoundObject] = []
    for name, site in sorted(world.sites.items()):
        if wanted.site not in ("", name) or (after is not None and name < after[0]):
            continue
        beyond = after[1] if after is not None and name == after[0] else ""
        here = (each for each in list(site.objects.values()) if each.of.id > beyond and wanted.filters.fit(each))
        current = not site.is_behind and sites.is_current(name, now_ns)
        first = heapq.nsmallest(most - len(found), here, key=lambda placed: placed.of.id)
        found += [FoundObject(name, each, current) for each in first]
        if len(found) >= most:
            break
    return found


def object_routes(monitor: Monitor) -> APIRouter:
    """Return the routes."""
    router = APIRouter(prefix="/objects", tags=["objects"])
    exporting = asyncio.Lock()
    fleet = monitor.fleet

    @router.get("", response_model=Page[ObjectAnswer])
    async def objects(wanted: FromQuery, limit: Limit = DEFAULT_LIMIT, after: After = None) -> Response:
        """The objects that world models keep, each once, by site and id."""
        now_ns, place = time.time_ns(), None if after is None else place_of(after, (str, str))
        found = await first_objects(fleet, wanted, limit + 1, place)
        items, mark = first_of(found, lambda each: (each.site, each.placed.of.id), limit)
        bodies = [encoded_answer(object_answer(each)) async for each in in_turns(items)]
        return page_response(now_ns, bodies, mark)

    @router.get("/export", response_class=FileResponse, responses=FILES)
    async def export(
        wanted: FromQuery,
        kind: Annotated[Literal["csv", "parquet"], Query(alias="format")] = "csv",
        *,
        bom: Annotated[bool, Query(description="begin CSV with a byte order mark, as Excel needs it")] = False,
    ) -> FileResponse:
        """All matching objects as a file, by site and id; one export runs at a time."""
        if kind == "parquet" and find_spec("polars") is None:
            raise HTTPException(422, "Parquet needs polars, which is not installed: install fleetsight[parquet]")
        if exporting.locked():
            raise HTTPException(503, "another export is running; try again later", {"Retry-After": "10"})
        async with exporting:
            folder = await asyncio.to_thread(TemporaryDirectory, prefix="fleetsight-")
            file = Path(folder.name) / f"objects.{kind}"
            try:
                count = sum(len(site.objects) for site in fleet.world.sites.values())
                found = await first_objects(fleet, wanted, count)
                await asyncio.to_thread(_write, found, file, bom=bom)
            except BaseException:
                await asyncio.to_thread(folder.cleanup)
                raise
        return FileResponse(file, media_type=KINDS[kind], filename=file.name, background=BackgroundTask(folder.cleanup))

    @router.get("/{site}/{object_id:path}")
    async def one(site: str, object_id: str) -> ObjectAnswer:
        """One object of a site, as it was told last."""
        known = fleet.world.sites.get(site)
        placed = None if known is None else known.objects.get(object_id)
        if known is None or placed is None:
            what = f"no site {site[:64]!r}" if known is None else f"no object {object_id[:64]!r} in site {site}"
            raise HTTPException(404, f"{what}; history/events has what became of objects that are gone")
        current = not known.is_behind and fleet.sites.is_current(site, time.time_ns())
        return object_answer(FoundObject(site, placed, current))

    return router


def object_answer(found: FoundObject) -> ObjectAnswer:
    """Return an object's model."""
    of = found.placed.of
    xx, _, _, yy, *_ = of.covariance
    return ObjectAnswer(
        site=found.site,
        id=of.id,
        name=of.name,
        current=found.current,
        x=of.at[0],
        y=of.at[1],
        z=of.at[2],
        sigma_m=math.sqrt(max(xx, yy, 0.0)),
        length=of.size[0],
        width=of.size[1],
        height=of.size[2],
        yaw=of.yaw,
        zones=found.placed.zones,
        existence=of.existence,
        first_seen=known_moment(of.first_ns),
        last_seen=known_moment(of.last_ns),
        looked_in_vain=known_moment(of.looked_ns),
        seen_by=tuple(
            SeerAnswer(robot=each.robot, camera=each.camera, last_seen=moment(each.last_ns)) for each in of.seen_by
        ),
        sightings=of.sightings,
        velocity=of.velocity,
    )


def object_row(found: FoundObject) -> Body:
    """Return an object as a row of a file. robot, camera: those that saw it last. zones: joined by semicolons."""
    answer = object_answer(found)
    row = {name: rounded(getattr(answer, name, None)) for name in COLUMNS}
    by = answer.seen_by[0] if answer.seen_by else None
    vx, vy = answer.velocity or (None, None)
    return row | {
        "class": answer.name,
        "zones": ";".join(answer.zones),
        "robot": "" if by is None else by.robot,
        "camera": "" if by is None else by.camera,
        "velocity_x": rounded(vx),
        "velocity_y": rounded(vy),
    }


def _write(found: Sequence[FoundObject], file: Path, *, bom: bool) -> None:
    rows = map(object_row, found)
    if file.suffix == ".parquet":
        _write_parquet(list(rows), file)
        return
    with file.open("w", encoding="utf-8-sig" if bom else "utf-8", newline="") as text:
        writer = csv.DictWriter(text, COLUMNS)
        writer.writeheader()
        writer.writerows({name: as_text(_said(value)) for name, value in row.items()} for row in rows)


def _said(value: Any) -> Any:
    return value.isoformat(timespec="microseconds") if hasattr(value, "isoformat") else value


def _write_parquet(rows: Sequence[Body], file: Path) -> None:
    import polars as pl  # noqa: PLC0415 - an extra, and only who wants Parquet needs it

    kinds: dict[str, Any] = dict.fromkeys(COLUMNS, pl.Float64)
    kinds |= dict.fromkeys(TEXTS, pl.String) | dict.fromkeys(TIMES, pl.Datetime("us", "UTC"))
    kinds |= {"sightings": pl.Int64, "current": pl.Boolean}
    pl.DataFrame(rows, schema=kinds, orient="row").write_parquet(file)
