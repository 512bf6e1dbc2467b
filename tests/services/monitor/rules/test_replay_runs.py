"""A rule that is tried on the history knows when a monitor ran."""

from services.monitor.rules.timeline import FOREVER_NS, Run, Timeline
from tests.services.monitor.history.support.stored_intervals import there
from tests.services.monitor.inventory.seeing import S
from tests.services.monitor.rules.replaying import HISTORY, tried

RUNS = [there(10, 20, ""), there(30, 35, "", is_open=True)]


def test_before_the_first_monitor_that_is_kept_another_one_ran() -> None:
    assert list(Timeline().runs()) == [Run(0, FOREVER_NS, told=False)]
    runs = [Run(0, 10 * S, told=False), Run(10 * S, 20 * S, told=True), Run(30 * S, FOREVER_NS, told=True)]
    assert list(Timeline(presences=RUNS[::-1]).runs()) == runs
    assert (Timeline().told_ns, Timeline(presences=RUNS).told_ns) == (FOREVER_NS, 10 * S)


def test_a_run_ends_at_the_latest_when_the_next_one_begins() -> None:
    runs = list(Timeline(presences=[there(10, 25, ""), there(20, 25, "", is_open=True)]).runs())
    assert [(run.since_ns // S, run.until_ns) for run in runs[1:]] == [(10, 20 * S), (20, FOREVER_NS)]


def test_history_of_before_anybody_kept_who_was_there_is_tried_as_well() -> None:
    led = there(65, 70, "", is_open=True)
    many = {"when": "over", "class": "box", "count": 2}
    assert tried(many, *HISTORY, led) == tried(many)
    assert tried({"when": "silent"}, there(1, 50), led) == [(68, "raised")], "it was there not a day before"
