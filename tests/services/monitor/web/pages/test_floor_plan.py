from dataclasses import replace

import httpx
from starlette.applications import Starlette

from services.monitor.map.floor_plan import FloorPlan
from services.monitor.web.pages.map import floor_plan_route, url_of

PLAN = FloorPlan(b"\x89PNG", 3.0, 2.0, 0.0, 0.0, 0.0, ())


async def test_its_image_is_fetched_once_and_another_one_has_another_name() -> None:
    transport = httpx.ASGITransport(Starlette(routes=[floor_plan_route(PLAN)]))
    async with httpx.AsyncClient(transport=transport, base_url="http://here") as client:
        answer = await client.get(url_of(PLAN))
        assert (answer.content, answer.headers["content-type"]) == (PLAN.png, "image/png")
        assert "immutable" in answer.headers["cache-control"]
        other = await client.get(url_of(replace(PLAN, png=b"other")))
        assert other.status_code == 404
