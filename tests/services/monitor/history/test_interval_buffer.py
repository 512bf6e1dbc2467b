import pytest
from msgspec.structs import replace

from services.monitor.history import interval_buffer as module
from services.monitor.history.interval_buffer import IntervalBuffer, StoredInterval
from services.monitor.history.intervals import Interval
from services.monitor.history.presence import Presence
from tests.services.monitor.history.support.stored_intervals import disagreement, there
from tests.services.monitor.history.test_store import interval
from tests.services.monitor.inventory.seeing import FRONT, S


def told(buffer: IntervalBuffer) -> list[tuple[int, int, bool]]:
    """Return what is to be written as (since, until, open), and take it as written."""
    some = buffer.pending(100)
    buffer.written(some)
    return [(each.since_ns // S, each.until_ns // S, each.open) for each in some]


def box(since_s: int, count: int = 1) -> Interval:
    return replace(interval(since_s, since_s, is_open=True), count=count)


def test_what_begins_ends_what_was_open_at_its_place() -> None:
    buffer = IntervalBuffer()
    buffer.begin(box(1))
    buffer.begin(there(2, 2, is_open=True))
    buffer.begin(box(3))
    assert told(buffer) == [(1, 3, False), (2, 2, True), (3, 3, True)]
    buffer.end(Presence, ("r1", ""), 1 * S)
    assert told(buffer) == [(2, 2, False)], "nothing ends before it began"
    buffer.end(Presence, ("r1", ""), 9 * S)
    assert told(buffer) == []


def test_one_place_has_one_open_interval_of_each_kind() -> None:
    buffer = IntervalBuffer()
    buffer.begin(box(1))
    buffer.begin(disagreement(2, 2, is_open=True))
    assert told(buffer) == [(1, 1, True), (2, 2, True)]
    assert buffer.opened(Interval, (FRONT, "box")) == box(1)
    assert buffer.opened(Presence, (FRONT, "box")) is None


def test_what_changed_while_it_was_written_is_written_again() -> None:
    buffer = IntervalBuffer()
    buffer.begin(box(1))
    under_way = buffer.pending(100)
    buffer.end(Interval, (FRONT, "box"), 8 * S)
    buffer.written(under_way)
    assert told(buffer) == [(1, 8, False)]


def test_what_another_monitor_goes_on_with_is_not_written_any_more() -> None:
    buffer = IntervalBuffer()
    buffer.begin(there(1, 1, "", is_open=True))
    buffer.forget_pending(0)
    buffer.drop(Presence, ("", ""))
    buffer.merge([], 0, gap_ns=5 * S, followed=True)
    assert told(buffer) == []


@pytest.mark.parametrize(
    ("old", "ours", "heartbeat_s", "written"),
    [
        (box(2), box(5), 8, [(2, 5, True)]),
        (box(5), box(5), 8, [(5, 5, True)]),
        (box(2, count=3), box(5), 4, [(2, 4, False), (5, 5, True)]),
        (box(2, count=3), box(5), 8, [(2, 5, False), (5, 5, True)]),
        (interval(1, 2, name="pallet", is_open=True), box(5), 8, [(1, 8, False), (5, 5, True)]),
        (there(1, 1, is_open=True), there(5, 5, is_open=True), 4, [(1, 5, True)]),
        (there(1, 1, "", is_open=True), there(5, 5, "", is_open=True), 4, [(1, 4, False), (5, 5, True)]),
        (disagreement(1, 1, is_open=True), disagreement(5, 5, is_open=True), 4, [(1, 5, True)]),
        (disagreement(1, 1, (2, 0), is_open=True), disagreement(5, 5, is_open=True), 4, [(1, 4, False), (5, 5, True)]),
    ],
    ids=[
        "same count",
        "same",
        "other count",
        "other count and late",
        "not here",
        "still there",
        "another monitor",
        "still disagreeing",
        "disagreeing otherwise",
    ],
)
def test_another_monitors_intervals_go_on_or_end(
    old: StoredInterval, ours: StoredInterval, heartbeat_s: int, written: list[tuple[int, int, bool]]
) -> None:
    buffer = IntervalBuffer()
    buffer.begin(ours)
    buffer.forget_pending(0)
    buffer.merge([old], heartbeat_s * S, gap_ns=5 * S, followed=True)
    assert told(buffer) == written


def ended(since_s: int, until_s: int) -> Interval:
    return replace(interval(since_s, until_s), count=1)


@pytest.mark.parametrize(
    ("stored", "ends_s", "written"),
    [
        (box(2), 9, [(2, 9, False)]),
        (box(2), 7, [(2, 7, False)]),
        (ended(2, 6), 7, [(2, 7, False)]),
        (ended(2, 6), None, [(2, 3, True)]),
        (box(7, count=2), 7, [(7, 8, False)]),
        (box(8), 7, [(8, 8, False)]),
    ],
    ids=[
        "ended since",
        "ended before, as was known later",
        "ended",
        "ended and may go on",
        "another one since",
        "another one after that",
    ],
)
def test_what_another_monitor_saw_as_well_is_one_interval(
    stored: StoredInterval, ends_s: int | None, written: list[tuple[int, int, bool]]
) -> None:
    """We saw it begin a second later than it did."""
    buffer = IntervalBuffer()
    buffer.begin(box(3))
    buffer.forget_pending(0)
    if ends_s is not None:
        buffer.end(Interval, (FRONT, "box"), ends_s * S)
    buffer.merge([stored], 8 * S, gap_ns=5 * S, followed=True)
    assert told(buffer) == written


def test_what_ended_while_another_monitor_wrote_is_not_written_again() -> None:
    buffer = IntervalBuffer()
    for second in (3, 5, 9):
        buffer.begin(box(second, count=second))
    buffer.merge([box(4, count=5)], 8 * S, gap_ns=5 * S, followed=True)
    assert sorted(told(buffer)) == [(4, 9, False), (9, 9, True)]


def test_what_came_too_late_for_the_last_write_of_another_monitor_is_written() -> None:
    buffer = IntervalBuffer()
    for name, since_s, until_s in [("pallet", 5, 6), ("forklift", 7, 7), ("box", 5, 6), ("cone", 1, 2)]:
        buffer.begin(replace(box(since_s), name=name))
        buffer.end(Interval, (FRONT, name), until_s * S)
    buffer.begin(there(4, 4, camera="front", is_open=True))
    buffer.end(Presence, ("r1", "front"), 6 * S)
    stored = [ended(4, 6), replace(ended(1, 3), name="pallet")]
    buffer.merge(stored, 8 * S, gap_ns=5 * S, followed=True, ended_of=Interval)
    assert [each.name for each in buffer.pending(9) if isinstance(each, Interval)] == ["pallet", "forklift", "box"]
    assert told(buffer) == [(5, 6, False), (7, 7, False), (4, 6, False)], "the box as it is there; the cone is too old"


def test_of_what_came_too_late_where_something_was_open_all_is_written() -> None:
    buffer = IntervalBuffer()
    for since_s, count in [(1, 3), (4, 4)]:
        buffer.begin(box(since_s, count=count))
    buffer.end(Interval, (FRONT, "box"), 6 * S)
    opened = replace(box(1, count=3), until_ns=8 * S)
    buffer.merge([opened], 8 * S, gap_ns=10 * S, followed=True, ended_of=Interval)
    assert sorted(told(buffer)) == [(1, 4, False), (4, 6, False)]


def test_a_follower_keeps_what_ended_since_whoever_leads_may_have_gone() -> None:
    buffer = IntervalBuffer()
    for second in (3, 5, 9):
        buffer.begin(box(second, count=second))
    buffer.forget_pending(8 * S)
    assert told(buffer) == [(5, 9, False)]


def test_what_was_before_that_which_both_saw_was_written_by_the_other_whose_clock_is_behind() -> None:
    buffer = IntervalBuffer()
    for second in (3, 5, 9):
        buffer.begin(box(second, count=second))
    buffer.merge([box(7, count=9)], 8 * S, gap_ns=5 * S, followed=True)
    assert told(buffer) == [(7, 9, True)]


def test_what_was_there_again_while_nobody_wrote_did_not_go_on() -> None:
    buffer = IntervalBuffer()
    buffer.begin(box(9, count=2))
    buffer.begin(box(11))
    buffer.merge([box(6)], 8 * S, gap_ns=60 * S, followed=True)
    assert sorted(told(buffer)) == [(6, 8, False), (9, 11, False), (11, 11, True)]


def test_over_a_long_gap_nothing_goes_on() -> None:
    buffer = IntervalBuffer()
    for ours in (box(105), there(105, 105, is_open=True)):
        buffer.begin(ours)
    buffer.forget_pending(0)
    buffer.merge([box(1), there(1, 1, is_open=True)], 8 * S, gap_ns=60 * S, followed=True)
    assert told(buffer) == [(1, 8, False), (1, 8, False), (105, 105, True), (105, 105, True)]


def test_what_happened_while_the_database_was_gone_is_kept() -> None:
    buffer = IntervalBuffer()
    buffer.begin(box(1))
    assert told(buffer) == [(1, 1, True)]
    buffer.begin(box(3, count=2))
    buffer.begin(box(5))
    buffer.merge([box(1)], 2 * S, gap_ns=60 * S, followed=False)
    assert sorted(told(buffer)) == [(1, 3, False), (3, 5, False), (5, 5, True)]


def test_what_waits_is_bounded_and_the_oldest_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_PENDING", 2)
    buffer = IntervalBuffer()
    for second in (1, 2, 3, 4):
        buffer.begin(box(second))
    assert (len(buffer), buffer.lost) == (2, 2)
    assert told(buffer) == [(3, 4, False), (4, 4, True)]
