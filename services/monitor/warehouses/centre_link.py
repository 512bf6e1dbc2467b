"""The state of this monitor's link to a centre, for those who show it."""

from collections.abc import Iterator
from contextlib import contextmanager

from bus import Bus


class CentreLink:
    """The link to the centre, once there is one; a monitor without a centre has one that is never used."""

    def __init__(self) -> None:
        self._bus: Bus | None = None

    @contextmanager
    def using(self, bus: Bus) -> Iterator[None]:
        """Tell of this bus within the context."""
        self._bus = bus
        try:
            yield
        finally:
            self._bus = None

    @property
    def problem(self) -> str:
        """Why the centre is not told of this warehouse, in words, or empty."""
        why = "" if self._bus is None else self._bus.link_problem
        return f"the centre is not told of this warehouse: {why}" if why else ""
