"""Routes for who watches the monitor itself: /healthz and /metrics."""

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse

from services.monitor.monitor import Monitor
from services.monitor.web.auth.access import Access
from services.monitor.web.auth.gate import HEALTH, METRICS
from services.monitor.web.auth.visitor import STATE
from services.monitor.web.metrics import CONTENT_TYPE, metrics_of


def watching_routes(monitor: Monitor, access: Access) -> APIRouter:
    """Return the routes."""
    router = APIRouter(include_in_schema=False)

    @router.get(HEALTH)
    async def health(request: Request) -> Response:
        """503 while the fleet cannot be heard; strangers hear what is wrong, not where."""
        dead, not_kept = monitor.health.problem, monitor.history.status.problem
        degraded = {
            "the history is not being kept": not_kept,
            "log-ins": access.problem,
            "rules": monitor.rules.problem,
        }
        told = {what: why for what, why in degraded.items() if why}
        answer: dict[str, object] = {"status": "dead" if dead else "degraded" if told else "ok"}
        visitor = request.scope[STATE]
        may_look = visitor is not None and visitor.may_look
        if may_look or dead or told:
            answer |= {"reason": dead and (dead if may_look else "the fleet cannot be heard"), "degraded": sorted(told)}
        if may_look:
            answer["details"] = told
        return JSONResponse(answer, 503 if dead else 200)

    @router.get(METRICS)
    async def metrics() -> Response:
        return Response(await metrics_of(monitor), media_type=CONTENT_TYPE)

    return router
