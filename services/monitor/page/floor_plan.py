"""Where a browser gets the floor plan's image: under a name that says what it shows, so that it is fetched once."""

from typing import Final

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from services.monitor.mapping.floor_plan import FloorPlan

FOR_EVER: Final = {"Cache-Control": "private, max-age=31536000, immutable"}


def url_of(plan: FloorPlan) -> str:
    """Return where a browser finds its image."""
    return f"/floor-plan/{plan.digest}.png"


def floor_plan_route(plan: FloorPlan) -> Route:
    """Return what answers there."""

    async def image(_: Request) -> Response:
        return Response(plan.png, media_type="image/png", headers=FOR_EVER)

    return Route(url_of(plan), image)
