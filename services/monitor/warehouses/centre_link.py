"""The state of this monitor's link to a centre, for those who show it."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from bus import Bus

_log: Final = logging.getLogger(__name__)


class CentreLink:
    """The link to the centre, once there is one; a monitor without a centre has one that is never used."""

    def __init__(self) -> None:
        self._bus: Bus | None = None
        self._refused = ""

    @contextmanager
    def using(self, bus: Bus) -> Iterator[None]:
        """Tell of this bus within the context."""
        self._bus, self._refused = bus, ""
        try:
            yield
        finally:
            self._bus = None

    def refuse(self, why: str) -> None:
        """Note why no report goes out; empty once one does."""
        if why and why != self._refused:
            _log.warning("the centre is not told of this warehouse: %s", why)
        self._refused = why

    @property
    def problem(self) -> str:
        """Why the centre is not told of this warehouse, in words, or empty."""
        why = self._refused or ("" if self._bus is None else self._bus.link_problem)
        return f"the centre is not told of this warehouse: {why}" if why else ""
