"""Routes of a centre: the warehouses that report to it, and the objects of one of their sites."""

import time
from typing import Annotated, Final

from fastapi import APIRouter, HTTPException, Path, Query, Response

from bus import NotServedError, RefusedError, RequestError, RequestTimeoutError
from schemas.errors import SchemaError
from schemas.world import MAX_OBJECTS, WorldAnswer
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.formats import moment
from services.monitor.monitor import Monitor
from services.monitor.warehouses.reports import KnownWarehouse
from services.monitor.warehouses.requests import WarehouseObjects
from services.monitor.web.api.bodies import alert_answer, encoded_answer, page_response
from services.monitor.web.api.models import Page
from services.monitor.web.api.objects import FoundObject, object_answer
from services.monitor.web.api.paging import After, ClassName, Limit, first_of, page_of, place_of
from services.monitor.web.api.world_models import ObjectAnswer, SiteTotalsAnswer, WarehouseAnswer
from services.monitor.world.site_objects import PlacedObject

DEFAULT_LIMIT: Final = 200

WarehouseName = Annotated[str, Path(min_length=1, max_length=64)]
SiteName = Annotated[str, Query(min_length=1, max_length=64, description="the site")]


def warehouse_routes(monitor: Monitor) -> APIRouter:
    """Return the routes."""
    router = APIRouter(prefix="/warehouses", tags=["warehouses"])
    warehouses, asked = monitor.fleet.warehouses, WarehouseObjects(monitor.bus)

    def known(name: str) -> KnownWarehouse:
        found = warehouses.of(name)
        if found is None:
            raise HTTPException(404, f"no warehouse {name[:64]!r} has reported since this monitor began")
        return found

    @router.get("", response_model=Page[WarehouseAnswer])
    async def every(*, limit: Limit = DEFAULT_LIMIT, after: After = None) -> Response:
        """The warehouses that report to this monitor as their centre, by name: totals and open alerts."""
        now_ns = time.time_ns()
        by_name = sorted(warehouses.every(), key=lambda each: each.name)
        found, mark = page_of(by_name, lambda each: (each.name,), limit, after, 1)
        bodies = [encoded_answer(warehouse_answer(each, now_ns)) async for each in in_turns(found)]
        return page_response(now_ns, bodies, mark)

    @router.get("/{name}")
    async def one(name: WarehouseName) -> WarehouseAnswer:
        """One warehouse as it reported last."""
        return warehouse_answer(known(name), time.time_ns())

    @router.get("/{name}/objects", response_model=Page[ObjectAnswer])
    async def objects(
        name: WarehouseName, site: SiteName, *, of: ClassName = "", limit: Limit = DEFAULT_LIMIT, after: After = None
    ) -> Response:
        """The objects of a site of a warehouse, by id, as its world model had them at most 5 s ago; without zones."""
        known(name)
        behind = "" if after is None else place_of(after, (str,))[0]
        answer = await _answer_of(asked, name, site, of)
        if not answer.complete:
            raise HTTPException(422, f"site {site} has more than {MAX_OBJECTS:,} of these objects: ask for one `class`")
        here = sorted((each for each in answer.objects if each.id > behind), key=lambda each: each.id)
        items, mark = first_of(here[: limit + 1], lambda each: (each.id,), limit)
        made = [object_answer(FoundObject(site, PlacedObject(each, ()), current=True)) for each in items]
        return page_response(answer.now_ns, [encoded_answer(each) async for each in in_turns(made)], mark)

    return router


async def _answer_of(asked: WarehouseObjects, warehouse: str, site: str, name: str) -> WorldAnswer:
    try:
        return await asked.of(warehouse, site, name)
    except NotServedError as error:
        raise HTTPException(503, f"warehouse {warehouse} cannot be reached: {error}") from error
    except RequestTimeoutError as error:
        raise HTTPException(504, f"warehouse {warehouse} does not answer: {error}") from error
    except RefusedError as error:
        raise HTTPException(404, f"warehouse {warehouse}: {error}") from error
    except (RequestError, SchemaError) as error:
        raise HTTPException(502, f"warehouse {warehouse}: {error}") from error


def warehouse_answer(known: KnownWarehouse, now_ns: int) -> WarehouseAnswer:
    """Return a warehouse's model."""
    of = known.report
    return WarehouseAnswer(
        warehouse=of.warehouse,
        current=known.is_current(now_ns),
        last_report=moment(known.received_ns),
        version=of.version,
        page=of.page,
        robots=of.robots,
        robots_online=of.robots_online,
        cameras=of.cameras,
        cameras_online=of.cameras_online,
        workers=of.workers,
        objects=dict(sorted(known.objects.items())),
        in_view=dict(of.in_view),
        sites=tuple(SiteTotalsAnswer.model_validate(each) for each in of.sites),
        alerts=dict(of.alerts),
        open_alerts=tuple(alert_answer(each, (), None) for each in of.open),
        problems=tuple(of.problems),
    )
