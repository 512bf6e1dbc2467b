"""Whether what an open alert says is known now. Pure: time is an argument."""

from schemas.alerts import Alert, AlertState
from schemas.keys import CameraKey
from services.monitor.inventory.inventory import Inventory


def known_until_ns(alert: Alert, inventory: Inventory, now_ns: int) -> int | None:
    """Return until when it was known what an alert says; None while it is, of silence itself, and of what is over.

    That is when its camera was heard last, or when it was raised where nobody remembers that.
    """
    if alert.state is AlertState.RESOLVED or not alert.name:  # only silence is of no class
        return None
    view = inventory.camera(CameraKey(alert.robot, alert.camera))
    if view is None:
        return alert.raised_ns
    return None if inventory.speaks(view, now_ns) else view.last_ns or alert.raised_ns
