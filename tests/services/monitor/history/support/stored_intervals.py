"""Intervals of every kind for tests."""

from schemas.keys import CameraKey
from services.monitor.history.intervals import Disagreement
from services.monitor.history.presence import Presence
from tests.services.monitor.inventory.seeing import FRONT, S


def there(since_s: int, until_s: int, robot: str = "r1", camera: str = "", *, is_open: bool = False) -> Presence:
    """Return the interval of who was there; of the monitor itself where neither is named."""
    return Presence(robot, camera, since_ns=since_s * S, until_ns=until_s * S, open=is_open)


def disagreement(
    since_s: int,
    until_s: int,
    counts: tuple[int, int] = (2, 1),
    *,
    key: CameraKey = FRONT,
    name: str = "box",
    is_open: bool = False,
) -> Disagreement:
    """Return the interval of a disagreement between the models m and n."""
    ours, theirs = counts
    since_ns, until_ns = since_s * S, until_s * S
    return Disagreement(key, name, ours, "m", theirs, "n", since_ns=since_ns, until_ns=until_ns, open=is_open)
