"""Whether the monitor hears the fleet, and has for so long that who is not heard is not there. Pure."""

from collections.abc import Callable
from typing import Final

from services.monitor.inventory.debouncing import NS
from services.monitor.inventory.inventory import SETTLE_NS

PULSE_S: Final = 1.0
"""How often the monitor sends itself a message."""

GAP_S: Final = 1.0
"""By how much later than that everybody is gone a monitor may notice that its link is."""


class Hearing:
    """Follows what the monitor hears. Seconds are of the steady clock.

    heard: when the monitor heard a message of its own last, None while it knows that it cannot hear the fleet.
    lease_s: after how long a link counts as lost: as much later than the monitor's own others may notice theirs.
    deaf: the fleet is not heard. settled: it is, and everybody who is there had time to appear.
    """

    def __init__(self, heard: Callable[[], float | None], lease_s: float) -> None:
        self._heard = heard
        self.lease_s = lease_s
        self._patience_s = lease_s + 2 * PULSE_S
        self._settle_s = SETTLE_NS / NS + lease_s
        self._settled_s = 0.0
        self.heard_s = 0.0
        self.deaf = False
        self.settled = True

    def advance(self, now_s: float) -> bool:
        """Let time pass; return whether the monitor became deaf, hears again or has settled.

        It is deaf too while its own message is late: it was held up, and so may have been who heard nothing of it.
        """
        before = (self.deaf, self.settled)
        heard_s = self._heard()
        deaf = heard_s is None or now_s - heard_s > self._patience_s
        if self.deaf and not deaf:
            self._settled_s = now_s + self._settle_s
        self.heard_s = self.heard_s if heard_s is None else heard_s
        self.deaf = deaf
        self.settled = not deaf and now_s >= self._settled_s
        return (self.deaf, self.settled) != before
