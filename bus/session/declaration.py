"""The protocol of declarations on a session, and their end, in which no error stops the rest."""

import logging
import re
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Final, Protocol

import zenoh

from bus.errors import BusError
from bus.session.panics import panics_are_errors

log: Final = logging.getLogger(__name__)


class Declaration(Protocol):
    """A declaration on a session. Both methods are called on the session's thread only."""

    @property
    def number_of(self) -> str:
        """The key for which it uses a numeric id (see bus.session.known_keys), or empty."""

    @property
    def takes_another(self) -> bool:
        """Whether it uses a new numeric id with each declaration."""

    def declare(self, session: zenoh.Session) -> None:
        """Declare; may raise zenoh.ZError, and `undeclare` is called then."""

    def undeclare(self) -> None:
        """Undo what `declare` did, if it was called."""


def endpoint_names(endpoints: Sequence[str]) -> str:
    return ", ".join(endpoints) or "any address found by scouting"


def take_back(declaration: Declaration) -> None:
    try:
        with panics_are_errors():
            declaration.undeclare()
    except Exception as error:  # noqa: BLE001 - the session may be gone already, or a thread stuck in the publisher
        log.debug("undeclaring failed: %s", error)


def close_session(session: zenoh.Session) -> None:
    try:
        with panics_are_errors():
            session.close()
    except (zenoh.ZError, BusError) as error:
        log.warning("the session did not close cleanly: %s", reason_of(error))


def log_failure(done: Future[None]) -> None:
    if not done.cancelled() and (error := done.exception()) is not None:
        log.error("the bus met an error: %s", error)


def reason_of(error: zenoh.ZError | BusError | OSError) -> str:
    """Return the system's error message, or Zenoh's without its source locations."""
    text = re.sub(r" at \S+\.rs:\d+\.?", "", str(error))
    said = re.search(r"([^:\[]+) \(os error \d+\)", text)
    return said[1].strip() if said else text
