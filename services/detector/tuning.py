"""Answers requests for a detector's settings while it works, and tells how they deviate from the configured ones."""

import logging

import msgspec

from bus import RefusedError, Reply, Request
from schemas import codec
from schemas.errors import SchemaError
from schemas.tuning import Tuning
from services.detector.model import Model, TuningError

log = logging.getLogger(__name__)

NOT_ACCEPTED = "this worker accepts no settings from others: start it with --accept-settings"


def answer(model: Model, request: Request, *, accept: bool) -> Reply:
    """Change the given settings and answer with all of them; without a payload nothing changes.

    accept: whether they may be changed.

    Raises:
        RefusedError: they may not be changed, or not to that.
    """
    try:
        if request.payload:
            tuning = codec.decode(Tuning, request.payload, request.encoding)
            if not accept:
                log.warning("settings refused: %s", NOT_ACCEPTED)  # without them: they may be a megabyte
                raise RefusedError(NOT_ACCEPTED)
            model.tune(tuning)
            log.info("settings changed: %s", model.tuning)
    except (SchemaError, TuningError) as error:
        raise RefusedError(str(error)) from error
    return Reply(codec.encode(model.tuning), codec.encoding(Tuning))


def deviations(configured: Tuning, tuning: Tuning) -> list[str]:
    """Return remarks on settings that requests have changed: none, or one."""
    before, now = msgspec.structs.asdict(configured), msgspec.structs.asdict(tuning)
    changed = [f"{name} {_text(now[name])}, not {_text(before[name])}" for name in before if now[name] != before[name]]
    return [f"settings changed by a request: {'; '.join(changed)}"] if changed else []


def _text(value: object) -> str:
    if isinstance(value, list):
        return " ".join(value) or "all"
    return f"{value:g}" if isinstance(value, float) else f"{value}"
