"""What a monitor of a test hears."""

import time

from services.monitor.liveness import Heartbeat


def hears(lease_s: float = 1.0) -> Heartbeat:
    """Return the hearing of a monitor that hears the fleet all the time."""
    return Heartbeat(time.monotonic, lease_s)
