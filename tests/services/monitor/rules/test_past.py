from msgspec.structs import replace

from services.monitor.rules.timeline import FOREVER_NS, Run, Timeline
from tests.services.monitor.history.lasting import disagreement, there
from tests.services.monitor.history.test_store import interval
from tests.services.monitor.inventory.seeing import S

RUNS = [there(10, 20, ""), there(30, 35, "", is_open=True)]


def test_before_the_first_monitor_that_is_kept_another_one_ran() -> None:
    assert list(Timeline().runs()) == [Run(0, FOREVER_NS, told=False)]
    runs = [Run(0, 10 * S, told=False), Run(10 * S, 20 * S, told=True), Run(30 * S, FOREVER_NS, told=True)]
    assert list(Timeline(presences=RUNS[::-1]).runs()) == runs
    assert (Timeline().told_ns, Timeline(presences=RUNS).told_ns) == (FOREVER_NS, 10 * S)


def test_a_run_ends_at_the_latest_when_the_next_one_begins() -> None:
    runs = list(Timeline(presences=[there(10, 25, ""), there(20, 25, "", is_open=True)]).runs())
    assert [(run.since_ns // S, run.until_ns) for run in runs[1:]] == [(10, 20 * S), (20, FOREVER_NS)]


def test_steps_are_in_order_and_what_ends_does_so_before_what_begins() -> None:
    past = Timeline([interval(5, 8), interval(8, 9, is_open=True)], [there(2, 8), *RUNS], [disagreement(8, 9)])
    steps = [(step.at_ns // S, type(step.of).__name__, step.begins, step.unseen) for step in past.steps()]
    assert steps[:2] == [(2, "Presence", True, False), (5, "Interval", True, True)]
    assert sorted(steps[2:4]) == [(8, "Interval", False, False), (8, "Presence", False, False)]
    assert sorted(steps[4:6]) == [(8, "Disagreement", True, False), (8, "Interval", True, False)]
    assert steps[6:] == [(9, "Disagreement", False, False)]


def test_what_nobody_saw_go_goes_when_its_camera_is_thought_silent() -> None:
    camera = replace(there(1, 9, camera="front"), heard_ns=6 * S)
    steps = {(step.at_ns // S, step.unseen) for step in Timeline([interval(2, 6)], [camera]).steps() if not step.begins}
    assert steps == {(9, True), (9, False)}
    steps = {(step.at_ns // S, step.unseen) for step in Timeline([interval(2, 5)], [camera]).steps() if not step.begins}
    assert steps == {(5, False), (9, False)}


def test_what_is_only_counted_otherwise_before_a_camera_falls_silent_is_not_lost() -> None:
    camera = replace(there(1, 9, camera="front"), heard_ns=6 * S)
    steps = Timeline([interval(2, 6), interval(6, 7, is_open=True)], [camera]).steps()
    assert [(step.at_ns // S, step.begins, step.unseen) for step in steps] == [
        (1, True, False),
        (2, True, True),
        (6, False, False),
        (6, True, False),
        (9, False, False),
    ]


def test_what_ended_when_it_began_is_not_there_afterwards() -> None:
    past = Timeline([interval(5, 5)], [there(2, 2)], [disagreement(3, 3)])
    assert [(step.at_ns // S, step.begins) for step in past.steps()] == [(2, False), (3, False)]


def test_a_past_reaches_from_what_ended_first_to_what_lasted_longest() -> None:
    assert (Timeline().first_ns, Timeline().last_ns) == (FOREVER_NS, 0)
    past = Timeline([interval(5, 8), interval(1, 9)], RUNS, [disagreement(8, 70)])
    assert (past.first_ns, past.last_ns) == (8 * S, 70 * S)
