"""What a monitor of a test hears."""

import time

from services.monitor.health import Hearing


def hears(lease_s: float = 1.0) -> Hearing:
    """Return the hearing of a monitor that hears the fleet all the time."""
    return Hearing(time.monotonic, lease_s)
