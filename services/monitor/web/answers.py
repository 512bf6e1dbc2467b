"""Error responses: one JSON object with one line, whatever the error."""

from collections.abc import Mapping
from typing import Any, Final

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError, WebSocketRequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from services.monitor.history.state import HistoryError
from services.monitor.monitor import RobotThereError, UnknownRobotError
from services.monitor.rules.subjects import UnknownAlertError

RETRY_S: Final = 2


def problem(status: int, reason: str, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """Return an error response."""
    return JSONResponse({"error": reason}, status, headers=headers)


def answer_errors(app: FastAPI) -> None:
    """Register these error responses with an application, also for WebSockets that are not accepted yet."""
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(WebSocketRequestValidationError, _invalid)
    app.add_exception_handler(HistoryError, _no_history)
    app.add_exception_handler(UnknownAlertError, _not_found)
    app.add_exception_handler(UnknownRobotError, _not_found)
    app.add_exception_handler(RobotThereError, _in_the_way)
    app.add_exception_handler(Exception, _internal)


def _http(_: Request, error: Any) -> JSONResponse:
    return problem(error.status_code, str(error.detail), error.headers)


def _invalid(_: Request, error: Any) -> JSONResponse:
    mistake = error.errors()[0]
    place = ".".join(str(part) for part in mistake["loc"][1:])
    reason = mistake["msg"].removeprefix("Value error, ")
    return problem(422, f"{place}: {reason}" if place else reason)


def _no_history(_: Request, error: Any) -> JSONResponse:
    return problem(503, f"the history cannot be read: {error}", {"Retry-After": str(RETRY_S)})


def _not_found(_: Request, error: Any) -> JSONResponse:
    return problem(404, str(error))


def _in_the_way(_: Request, error: Any) -> JSONResponse:
    return problem(409, str(error))


def _internal(_: Request, __: Any) -> JSONResponse:
    return problem(500, "internal error; the monitor's log says more")
