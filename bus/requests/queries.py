"""Requests as Zenoh queries. Functions that use a session run on its thread."""

from contextlib import suppress
from functools import partial
from typing import Final

import zenoh
from zenoh.handlers import Callback

from bus.api import MAX_TIMEOUT_S, Reply
from bus.requests.pending_request import PendingRequest

TIMEOUT_MS: Final = "timeout_ms"
"""Query parameter that tells the server how long the sender waits, in milliseconds."""

DEFAULT_TIMEOUT_S: Final = 10.0
ERROR_ENCODING: Final = "text/plain"
MAX_ERROR_BYTES: Final = 4_096
LATE_S: Final = 1.0
"""Extra lifetime of a query, so that the sender's own timeout comes first."""


def send_query(session: zenoh.Session, asking: PendingRequest, *, served_here: bool) -> None:
    """Send a query. Query and reply are dropped under congestion; then the sender's timeout ends the request.

    served_here: the session has a server of the key; Zenoh (1.10) would ask that one and another one too.

    Raises:
        zenoh.ZError: the session is closed.

    """
    session.get(
        f"{asking.key}?{TIMEOUT_MS}={round(asking.timeout_s * 1000)}",
        Callback(partial(_on_reply, asking), asking.give_up, indirect=False),
        target=zenoh.QueryTarget.BEST_MATCHING,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=asking.timeout_s + LATE_S,
        allowed_destination=zenoh.Locality.SESSION_LOCAL if served_here else zenoh.Locality.REMOTE,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.INTERACTIVE_LOW,
        payload=asking.payload,
        encoding=asking.encoding,
    )


def _on_reply(asking: PendingRequest, reply: zenoh.Reply) -> None:
    if reply.ok is not None:
        asking.settle(Reply(reply.ok.payload.to_bytes(), str(reply.ok.encoding)))
    elif reply.err is not None:
        asking.refuse(_error_text(reply.err.payload))


def _error_text(payload: zenoh.ZBytes) -> str:
    if len(payload) > MAX_ERROR_BYTES:
        return f"an error of {len(payload)} bytes"
    return " ".join(payload.to_bytes().decode(errors="replace").split())


def finish_query(query: zenoh.Query, served: str, outcome: Reply | str | None) -> None:
    """Answer a query to a server of `served`, and release it."""
    with query, suppress(zenoh.ZError):  # the caller or the session is gone
        key = served if "*" not in served else str(query.key_expr)
        if isinstance(outcome, Reply) and "*" in key:
            outcome = f"{key} has wildcards; request a single key"
        if isinstance(outcome, Reply):
            query.reply(key, outcome.payload, encoding=outcome.encoding)
        elif outcome is not None:
            query.reply_err(outcome, encoding=ERROR_ENCODING)


def timeout_of(text: str | None) -> float:
    """Return the seconds that a query's sender waits, at most MAX_TIMEOUT_S."""
    if text is None or not text.isascii() or not text.isdigit() or len(text) > 9:
        return DEFAULT_TIMEOUT_S
    return min(int(text) / 1000, MAX_TIMEOUT_S)
