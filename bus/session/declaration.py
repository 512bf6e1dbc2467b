"""What is declared on a session, and how it and the session are ended without an error that stops the rest."""

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
    """Something declared on a session. Both methods are called on the session's thread only."""

    @property
    def number_of(self) -> str:
        """The key whose number it takes (see bus.session.known_keys), or empty."""

    @property
    def takes_another(self) -> bool:
        """Whether it takes another number whenever it is declared."""

    def declare(self, session: zenoh.Session) -> None:
        """Declare; may raise zenoh.ZError, and is then undeclared."""

    def undeclare(self) -> None:
        """Undo whatever `declare` got done; nothing if it was never called."""


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


def reason_of(error: zenoh.ZError | BusError) -> str:
    """Return what the system said, or Zenoh's message without the places in its own sources."""
    text = re.sub(r" at \S+\.rs:\d+\.?", "", str(error))
    said = re.search(r"([^:\[]+) \(os error \d+\)", text)
    return said[1].strip() if said else text
