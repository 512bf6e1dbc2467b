"""The status of a history. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class HistoryStatus:
    """The status of the history.

    problem: why it is not being kept, in words, or empty. leads: this monitor is the one that raises alerts; while the
    database cannot be asked, that stays as it was, and whoever never could ask it raises them.
    pending: what waits to be written, none while another one leads. lost: intervals given up because too many waited.
    leader: who else leads, as host and process, as far as that is known. warnings: why old history is not forgotten.
    """

    problem: str
    leads: bool
    pending: int
    lost: int
    leader: str = ""
    warnings: Sequence[str] = ()
