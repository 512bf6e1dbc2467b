"""Routes about the monitor itself: the current user, its status, the rules in force."""

import time

from fastapi import APIRouter, HTTPException, Request

from bus.reporting import VERSION
from services.monitor.formats import moment
from services.monitor.history.errors import HistoryError
from services.monitor.monitor import Monitor
from services.monitor.web.api.models import HistoryAnswer, MeAnswer, RulesAnswer, StatusAnswer
from services.monitor.web.auth.users import visitor_of


def about_routes(monitor: Monitor) -> APIRouter:
    """Return the routes."""
    router = APIRouter(tags=["monitor"])

    @router.get("/me")
    async def me(request: Request) -> MeAnswer:
        """The user of the request, and their role."""
        visitor = visitor_of(request)
        if visitor.role is None:
            raise HTTPException(401, "logged out")
        return MeAnswer(name=visitor.name, role=visitor.role)

    @router.get("/status")
    async def status() -> StatusAnswer:
        """The status of the monitor itself."""
        glance = monitor.glance()
        return StatusAnswer(
            version=VERSION,
            now=moment(time.time_ns()),
            started=moment(monitor.started_ns),
            problems=tuple(filter(None, [monitor.health.problem, *monitor.problems()])),
            left_out=monitor.fleet.left_out,
            history=HistoryAnswer.model_validate(monitor.history.status),
            robots=len(glance.robots),
            robots_online=len(monitor.fleet.inventory.robots()),
            cameras=len(glance.cameras),
            alerts=await _alerts(monitor),
        )

    @router.get("/rules")
    async def rules() -> RulesAnswer:
        """The rules in force, and the mistake in the newest version of their file. Webhooks by name only."""
        book, file = monitor.rules.book, monitor.settings.rules
        return RulesAnswer(
            file=None if file is None else str(file),
            problem=monitor.rules.problem,
            remarks=tuple(monitor.rule_remarks()),
            timezone=book.timezone,
            webhooks=tuple(book.webhooks),
            rules=tuple(rule.model_dump(mode="json", by_alias=True) for rule in book.rules),
        )

    return router


async def _alerts(monitor: Monitor) -> int | None:
    try:
        return len(await monitor.current_alerts())
    except HistoryError:
        return None
