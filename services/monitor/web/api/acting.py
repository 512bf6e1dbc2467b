"""Who may do something, and where."""

from fastapi import HTTPException, Request

from services.monitor.monitor import Monitor
from services.monitor.web.auth.visitor import visitor_of


def operator_of(request: Request, monitor: Monitor) -> str:
    """Return the name of the operator who asks.

    Raises:
        HTTPException: it is none, or another monitor raises the alerts.
    """
    visitor = visitor_of(request)
    if not visitor.may_act:
        raise HTTPException(403, "only operators may do this")
    if not monitor.history.status.leads:
        raise HTTPException(409, "another monitor raises the alerts: ask that one")
    return visitor.name
