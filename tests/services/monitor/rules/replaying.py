"""A history that rules are tried on."""

from typing import Any

from msgspec.structs import replace

from services.monitor.history.interval_buffer import StoredInterval
from services.monitor.history.intervals import Disagreement, Interval
from services.monitor.history.presence import Presence
from services.monitor.rules.replay import replay
from services.monitor.rules.timeline import Timeline
from tests.services.monitor.history.test_store import interval
from tests.services.monitor.inventory.seeing import S
from tests.services.monitor.rules.ruling import book


def count(since_s: int, until_s: int, number: int, name: str = "box", **more: Any) -> Interval:
    return replace(interval(since_s, until_s, name=name), **{"count": number, "closest_m": None, **more})


HISTORY = [
    count(1, 10, 1),
    count(10, 20, 3),
    count(20, 30, 1),
    count(40, 50, 1, closest_m=1.25),
    count(60, 70, 1, open=True, closest_m=3.0),
]


def tried(rule: dict[str, Any], *past: StoredInterval) -> list[tuple[int, str]]:
    """Return when what became of the alerts that one rule raises over a past; over that of one box if none is given."""
    effects = replay(book(rule), past_of(*(past or HISTORY)))
    return [(effect.alert.changed_ns // S, effect.alert.state.value) for effect in effects]


def past_of(*some: StoredInterval) -> Timeline:
    return Timeline(
        [each for each in some if isinstance(each, Interval)],
        [each for each in some if isinstance(each, Presence)],
        [each for each in some if isinstance(each, Disagreement)],
    )
