"""Routes about alerts, the rules that raise them, and the monitor itself."""

import time
from collections.abc import Callable, Iterable
from typing import Annotated, Final

from fastapi import APIRouter, HTTPException, Path, Request

from bus.reporting import VERSION
from schemas.alerts import Alert, AlertState
from services.monitor.formats import moment
from services.monitor.history.state import Act, HistoryError
from services.monitor.monitor import Monitor
from services.monitor.web.api.bodies import alert_answer
from services.monitor.web.api.models import AlertAnswer, HistoryAnswer, MeAnswer, Page, RulesAnswer, StatusAnswer
from services.monitor.web.api.paging import After, Limit, Name, operator_of, page_of
from services.monitor.web.auth.users import visitor_of

DEFAULT_LIMIT: Final = 200

AlertId = Annotated[str, Path(min_length=1, max_length=64)]


def alert_routes(monitor: Monitor) -> APIRouter:
    """Return the routes."""
    router = APIRouter(tags=["alerts"])

    def answer(alert: Alert) -> AlertAnswer:
        return alert_answer(alert, monitor.acts_of(alert.id), monitor.known_until_ns(alert))

    @router.get("/alerts")
    async def alerts(*, robot: Name = "", limit: Limit = DEFAULT_LIMIT, after: After = None) -> Page[AlertAnswer]:
        """The unresolved alerts, whichever monitor raised them."""
        found = [alert for alert in await monitor.current_alerts() if robot in ("", alert.robot)]
        items, mark = page_of(sorted(found, key=_place), _place, limit, after, 1)
        return Page(now=moment(time.time_ns()), items=[answer(alert) for alert in items], next=mark)

    def act(do: Callable[[str, str], Alert], state: AlertState, alert_id: str, request: Request) -> AlertAnswer:
        who = operator_of(request, monitor)
        as_it_is = next((alert for alert in monitor.alerts() if alert.id == alert_id), None)
        if as_it_is is not None and _did(who, state, as_it_is, monitor.acts_of(alert_id)):
            return answer(as_it_is)  # a retry by a program that got no response
        return answer(do(alert_id, who))

    @router.post("/alerts/{alert_id}/acknowledge")
    async def acknowledge(alert_id: AlertId, request: Request) -> AlertAnswer:
        """Acknowledge an alert: it no longer escalates by itself."""
        return act(monitor.acknowledge, AlertState.ACKNOWLEDGED, alert_id, request)

    @router.post("/alerts/{alert_id}/escalate")
    async def escalate(alert_id: AlertId, request: Request) -> AlertAnswer:
        """Escalate an alert."""
        return act(monitor.escalate, AlertState.ESCALATED, alert_id, request)

    @router.post("/alerts/{alert_id}/resolve")
    async def resolve(alert_id: AlertId, request: Request) -> AlertAnswer:
        """Resolve an alert; it is raised again only after its condition has cleared."""
        return act(monitor.resolve, AlertState.RESOLVED, alert_id, request)

    return router


def _place(alert: Alert) -> tuple[str, ...]:
    return (alert.id,)


def _did(who: str, state: AlertState, alert: Alert, acts: Iterable[Act]) -> bool:
    """Whether a user's action led to the alert's current state."""
    mine = (act for act in acts if (act.who, act.state) == (who, state))
    return alert.state is state and any(act.at_ns >= alert.changed_ns for act in mine)


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
        fleet_view = monitor.fleet_view()
        return StatusAnswer(
            version=VERSION,
            now=moment(time.time_ns()),
            started=moment(monitor.started_ns),
            problems=tuple(filter(None, [monitor.health.problem, *monitor.problems()])),
            left_out=monitor.fleet.left_out,
            history=HistoryAnswer.model_validate(monitor.history.status),
            robots=len(fleet_view.robots),
            robots_online=len(monitor.fleet.inventory.robots()),
            cameras=len(fleet_view.cameras),
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
