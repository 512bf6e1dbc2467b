"""Rules replayed over the history."""

from typing import Any

import pytest
from msgspec.structs import replace

from schemas.keys import CameraKey
from services.monitor.history.interval_buffer import StoredInterval
from services.monitor.history.intervals import Interval
from services.monitor.rules.model import RuleBook
from services.monitor.rules.replay import caveats, replay
from services.monitor.rules.timeline import FOREVER_NS, NEVER, Timeline, available_periods
from tests.services.monitor.history.support.stored_intervals import disagreement, there
from tests.services.monitor.history.test_store import interval
from tests.services.monitor.inventory.seeing import FRONT, S
from tests.services.monitor.rules.replaying import count, past_of, tried
from tests.services.monitor.rules.ruling import book


@pytest.mark.parametrize(
    ("rule", "alerts"),
    [
        ({"when": "appears"}, [(40, "raised"), (50, "resolved"), (60, "raised")]),
        ({"when": "disappears"}, [(30, "raised"), (40, "resolved"), (50, "raised"), (60, "resolved")]),
        ({"when": "over", "count": 2}, [(10, "raised"), (20, "resolved")]),
        ({"when": "over", "count": 2, "for_s": 9}, [(19, "raised"), (20, "resolved")]),
        ({"when": "over", "count": 2, "for_s": 11}, []),
        (
            {"when": "under", "count": 1, "for_s": 9},
            [(39, "raised"), (40, "resolved"), (59, "raised"), (60, "resolved")],
        ),
        ({"when": "under", "count": 1, "for_s": 10}, []),
        ({"when": "nearer", "than_m": 1.5, "for_s": 5}, [(45, "raised"), (50, "resolved")]),
        ({"when": "over", "count": 0, "robots": ["r2"]}, []),
        ({"when": "over", "count": 2, "between": ["00:00:15", "06:00"]}, [(15, "raised"), (20, "resolved")]),
        ({"when": "over", "count": 2, "between": ["00:00:20", "06:00"]}, []),
    ],
)
def test_history_raises_what_it_would_have_raised(rule: dict[str, Any], alerts: list[tuple[int, str]]) -> None:
    assert tried({**rule, "class": "box"}) == alerts


@pytest.mark.parametrize(
    ("rule", "timezone", "raised_s"),
    [
        ({"days": ["fri"]}, "UTC", 24 * 3600),
        ({"days": ["fri"]}, "Europe/Berlin", 23 * 3600),
        ({"between": ["22:00", "06:00"], "days": ["sat"]}, "UTC", (48 + 22) * 3600),
    ],
)
def test_what_still_holds_when_the_time_comes_is_raised_then(
    rule: dict[str, Any], timezone: str, raised_s: int
) -> None:
    past = past_of(count(7 * 3600, 100 * 3600, 3))
    (raised, _) = replay(book({"when": "over", "class": "box", "count": 2, **rule}, timezone=timezone), past)
    assert raised.alert.raised_ns == raised_s * S, "the epoch began on a Thursday"


LED = there(1, 1_000, "", is_open=True)
"""One monitor, for as long as anything is known."""


DAY = 86_400


@pytest.mark.parametrize(
    ("past", "alerts"),
    [
        ([there(2, 20), LED], [(20, "raised")]),
        ([there(2, 20), there(30, 40, is_open=True), LED], [(20, "raised"), (30, "resolved")]),
        ([there(2, 3), there(4, 5), LED], [(5, "raised")]),
        ([there(2, 20)], []),
        ([there(2, 20, "other"), LED], []),
        ([there(2, 20, camera="front"), LED], []),
        ([there(2, 50), there(1, 50, "")], []),
        ([there(2, 50), there(1, 50, ""), there(90, 99, "", is_open=True)], [(93, "raised")]),
        ([there(2, 50), there(1, 50, ""), there(90, 99, "", is_open=True), there(92, 99, is_open=True)], []),
        ([there(2, 99, is_open=True), there(1, 50, ""), there(90, 99, "", is_open=True)], []),
        ([there(2, 40), there(1, 50, ""), there(90, 91, ""), there(92, 99, is_open=True)], [(40, "raised")]),
        (
            [there(2, 40), there(1, 50, ""), there(60, 70, is_open=True), there(90, 99, "", is_open=True)],
            [(40, "raised"), (93, "resolved")],
        ),
        ([there(2, 40), there(1, 41, ""), there(41 + DAY, 99 + DAY, "", is_open=True)], [(40, "raised")]),
    ],
    ids=[
        "gone",
        "gone and back",
        "gone while it was not known yet who is there",
        "nobody kept who led",
        "another robot",
        "a camera",
        "there when the monitor stopped",
        "not there when the next one began",
        "back before it was known who is there",
        "there all along",
        "gone and back while no monitor ran",
        "gone, and back while no monitor ran",
        "still gone when the next one began",
    ],
)
def test_a_robot_is_silent_when_a_monitor_was_there_and_it_was_not(
    past: list[StoredInterval], alerts: list[tuple[int, str]]
) -> None:
    assert tried({"when": "silent", "robots": ["r1"]}, *past) == alerts


def test_robots_that_are_gone_for_days_are_not_missed_again() -> None:
    gone, runs = there(2, 40), [there(1, 50, ""), there(60 + DAY, 99 + DAY, "", is_open=True)]
    silent = {"when": "silent", "for_s": 20}
    assert tried(silent, gone, *runs) == []
    nearly = [there(1, 50, ""), there(39 + DAY, 99 + DAY, "", is_open=True)]
    assert tried(silent, gone, *nearly) == [(62 + DAY, "raised")]


def test_what_must_hold_for_a_while_is_not_waited_for_while_no_monitor_runs() -> None:
    rule = {"when": "silent", "for_s": 15}
    runs = [there(1, 50, ""), there(60, 99, "", is_open=True)]
    assert tried(rule, there(2, 30), *runs) == [(45, "raised")]
    assert tried(rule, there(2, 40), *runs) == [(78, "raised")], "the next monitor begins to wait when it knows"


@pytest.mark.parametrize(
    ("past", "alerts"),
    [
        ([there(5, 20, camera="front"), LED], [(20, "raised")]),
        (
            [there(5, 20, camera="front"), there(25, 30, camera="front"), LED],
            [(20, "raised"), (25, "resolved"), (30, "raised")],
        ),
        ([there(5, 20, camera="rear"), there(5, 20), LED], []),
        ([count(5, 20, 1), LED], []),
    ],
    ids=["silent", "silent twice", "others", "never known to speak"],
)
def test_a_camera_is_silent_when_nobody_speaks_for_it(
    past: list[StoredInterval], alerts: list[tuple[int, str]]
) -> None:
    assert tried({"when": "silent", "cameras": ["front"]}, *past) == alerts


SPOKEN = [there(2, 99, camera="front", is_open=True), count(2, 99, 2, open=True), LED]


@pytest.mark.parametrize(
    ("past", "alerts"),
    [
        ([disagreement(10, 20), *SPOKEN], [(10, "raised"), (20, "resolved")]),
        ([disagreement(10, 20), disagreement(20, 30, (3, 1)), *SPOKEN], [(10, "raised"), (30, "resolved")]),
        ([disagreement(10, 20, name="pallet"), *SPOKEN], []),
        ([disagreement(10, 20, key=CameraKey("r1", "rear")), *SPOKEN], []),
        ([disagreement(10, 20), there(2, 20, camera="front"), count(2, 20, 2), LED], [(10, "raised")]),
        ([disagreement(10, 20), count(2, 99, 2, open=True)], []),
    ],
    ids=["and then agree", "otherwise", "about another class", "at another camera", "until silence", "not told"],
)
def test_models_disagree_as_long_as_they_do(past: list[StoredInterval], alerts: list[tuple[int, str]]) -> None:
    assert tried({"when": "disagree", "class": "box", "cameras": ["front"]}, *past) == alerts


def test_a_disagreement_says_who_counts_what() -> None:
    (raised, _) = replay(book({"when": "disagree"}), past_of(disagreement(10, 20, (3, 1)), *SPOKEN))
    assert raised.alert.text == "two models count 3 and 1 box in view of r1/front"


SILENT = [
    replace(there(2, 23, camera="front"), heard_ns=20 * S),
    there(99, 120, camera="front", is_open=True),
    count(2, 10, 1, name="pallet"),
    count(5, 20, 2),
    count(98, 120, 1, open=True),
    LED,
]
"""A camera from whose view a pallet went, that fell silent with two boxes in view, and was back with one."""


@pytest.mark.parametrize(
    ("rule", "alerts"),
    [
        ({"when": "over", "count": 1}, [(5, "raised"), (99, "resolved")]),
        ({"when": "over", "count": 1, "for_s": 20}, []),
        ({"when": "over", "count": 0, "for_s": 20}, [(99, "raised")]),
        ({"when": "disappears"}, []),
        ({"when": "disappears", "class": "pallet"}, [(10, "raised")]),
        ({"when": "under", "count": 1}, [(4, "raised"), (5, "resolved")]),
        ({"when": "appears"}, [(5, "raised")]),
    ],
)
def test_silence_changes_nothing_that_is_not_known(rule: dict[str, Any], alerts: list[tuple[int, str]]) -> None:
    assert tried({"class": "box", **rule}, *SILENT) == alerts


def test_what_went_while_its_camera_was_lost_is_over_once_the_camera_is_back() -> None:
    without = [each for each in SILENT if not isinstance(each, Interval) or each.since_ns < 98 * S]
    assert tried({"when": "appears", "class": "box"}, *without) == [(5, "raised"), (99, "resolved")]


def test_alerts_go_on_over_a_restart() -> None:
    many = {"when": "over", "class": "box", "count": 1}
    runs = [there(1, 50, ""), there(60, 99, "", is_open=True)]
    available = there(2, 99, camera="front", is_open=True)
    assert tried(many, count(2, 99, 2, open=True), available, *runs) == [(4, "raised")]
    assert tried(many, count(2, 40, 2), available, *runs) == [(4, "raised"), (40, "resolved")]
    assert tried(many, count(2, 55, 2), available, *runs) == [(4, "raised"), (63, "resolved")]


HOUR = 3_600
SPRING = 1_774_742_400
"""29 March 2026, 00:00 UTC: an hour later the clocks of Berlin go from two to three."""


@pytest.mark.parametrize(
    ("zone", "held_s", "filters", "raised_s"),
    [
        ("UTC", 10, {"between": ["22:00", "06:00"]}, 10),
        ("UTC", 7 * HOUR, {"between": ["22:00", "06:00"]}, 22 * HOUR),
        ("UTC", 7 * HOUR, {"between": ["22:07:30", "06:00"]}, 22 * HOUR + 450),
        ("UTC", 7 * HOUR, {"days": ["sat"]}, 2 * DAY),
        ("UTC", 7 * HOUR, {"days": ["sat"], "between": ["00:10", "01:00"]}, 2 * DAY + 600),
        ("Europe/Berlin", SPRING, {"between": ["05:30", "06:00"]}, SPRING + 3 * HOUR + 1_800),
        ("Europe/Berlin", SPRING, {"between": ["02:30", "06:00"]}, SPRING + HOUR),
    ],
)
def test_what_still_holds_when_the_hours_begin_is_raised_then(
    zone: str, held_s: int, filters: dict[str, Any], raised_s: int
) -> None:
    rule = {"name": "many", "when": "over", "class": "box", "count": 1, **filters}
    held = [count(held_s - 5, held_s, 1), count(held_s, held_s + 9 * DAY, 2), there(1, held_s + 9 * DAY, "")]
    effects = replay(RuleBook.model_validate({"rules": [rule], "timezone": zone}), past_of(*held))
    assert [effect.alert.raised_ns for effect in effects if effect.raised] == [raised_s * S]


def test_what_nobody_acknowledges_escalates_in_time() -> None:
    many = {"when": "over", "class": "box", "count": 1, "escalate_after_s": 25}
    available = there(2, 300, camera="front", is_open=True)
    runs = [there(1, 50, ""), there(200, 300, "", is_open=True)]
    assert tried(many, count(2, 300, 2, open=True), available, *runs) == [(4, "raised"), (29, "escalated")]
    many["escalate_after_s"] = 100
    assert tried(many, count(2, 300, 2, open=True), available, *runs) == [(4, "raised"), (200, "escalated")]


def test_what_cannot_be_tried_is_said() -> None:
    rules = book({"when": "silent"}, {"when": "disagree"}, {"when": "nearer", "class": "box", "than_m": 1})
    assert [note.split(": ")[1][:12] for note in caveats(rules)] == ["is tried wit"]
    assert list(replay(rules, Timeline())) == []


RUNS = [there(10, 20, ""), there(30, 35, "", is_open=True)]


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


TWICE = [
    replace(there(10, 23, camera="front"), heard_ns=20 * S),
    replace(there(100, 203, camera="front"), heard_ns=200 * S),
    there(220, 300, camera="front", is_open=True),
    there(1, 999, is_open=True),
]


@pytest.mark.parametrize(
    ("until_s", "lost_s"), [(9, None), (19, None), (20, 23), (21, 23), (24, None), (150, None), (200, 203), (250, None)]
)
def test_what_was_in_view_until_the_end_is_lost_when_the_camera_is_thought_silent(
    until_s: int, lost_s: int | None
) -> None:
    lost_ns = available_periods(TWICE)[FRONT].lost_ns(interval(5, until_s))
    assert lost_ns == (None if lost_s is None else lost_s * S)


@pytest.mark.parametrize(
    ("since_s", "first"), [(9, False), (15, False), (99, True), (100, True), (101, False), (219, False), (250, False)]
)
def test_what_was_there_when_a_lost_camera_spoke_again_did_not_come(since_s: int, *, first: bool) -> None:
    assert available_periods(TWICE)[FRONT].was_there_first(interval(since_s, 999)) == first


def test_of_a_camera_that_nobody_ever_spoke_for_nothing_is_known() -> None:
    assert set(available_periods(TWICE)) == {FRONT}
    assert (NEVER.lost_ns(interval(1, 2)), NEVER.was_there_first(interval(1, 2))) == (None, False)
