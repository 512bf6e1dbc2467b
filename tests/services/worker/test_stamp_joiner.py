from typing import Any

import pytest

from services.geometry.memory_budget import CROWDED, MemoryBudget
from services.worker.stamp_joiner import DOUBLE, FLUSHED, ITEM_BYTES, UNUSED, Joiner, NoPartner, Partner

MS = 1_000_000


def joiner(*stamps_ms: int, tolerance_ms: int | None = 10, **more: Any) -> Joiner[str]:
    made: Joiner[str] = Joiner("depth image", tolerance_ns=None if tolerance_ms is None else tolerance_ms * MS, **more)
    for stamp in stamps_ms:
        made.keep(stamp * MS, f"at {stamp}", 100)
    return made


def test_the_nearest_one_is_found_up_to_the_tolerance() -> None:
    made = joiner(100, 130)
    assert made.find(100 * MS) == Partner("at 100", 100 * MS)
    assert made.find(110 * MS) == Partner("at 100", 100 * MS)
    assert made.find(120 * MS) == Partner("at 130", 130 * MS)
    assert made.find(90 * MS) == Partner("at 100", 100 * MS)
    missing = made.find(110 * MS + 1)
    assert missing == NoPartner("no depth image of its instant: the nearest is 0.010 s before it", final=True)


def test_what_is_ahead_of_all_that_is_kept_may_still_find_one() -> None:
    assert joiner().find(5) == NoPartner("no depth image arrived", final=False)
    found = joiner(100).find(150 * MS)
    assert found == NoPartner("no depth image of its instant: the nearest is 0.050 s before it", final=False)
    assert joiner(100).find(50 * MS) == NoPartner(
        "no depth image of its instant: the nearest is 0.050 s after it", final=True
    )


def test_the_tolerance_is_half_the_streams_own_period() -> None:
    made = joiner(*range(0, 1000, 100), tolerance_ms=None)
    assert made.tolerance_ns == 50 * MS
    assert isinstance(made.find(851 * MS), Partner)


def nearest(of: Joiner[str], stamp_ms: int) -> tuple[str, bool]:
    """Return what is found, and whether nothing nearer may come."""
    found = of.find(stamp_ms * MS)
    assert isinstance(found, Partner)
    return found.item, found.final


def test_a_nearer_one_may_come_after_one_that_is_half_a_period_before() -> None:
    made = joiner(*range(0, 1000, 66), tolerance_ms=70)
    assert nearest(made, 990 + 33) == ("at 990", True)
    assert nearest(made, 990 + 34) == ("at 990", False)
    assert nearest(made, 990 + 66) == ("at 990", False)
    made.keep((990 + 66) * MS, "its own", 100)
    assert nearest(made, 990 + 66) == ("its own", True)


def test_nothing_nearer_comes_once_there_is_one_after_it() -> None:
    made = joiner(*range(0, 1000, 66), tolerance_ms=70)
    made.keep((990 + 132) * MS, "the next but one", 100)
    assert nearest(made, 990 + 65) == ("at 990", True)


def test_before_anything_is_measured_anything_may_come_nearer() -> None:
    made = joiner(100, tolerance_ms=70)
    assert nearest(made, 100) == ("at 100", True)
    assert nearest(made, 101) == ("at 100", False)
    assert nearest(joiner(100, tolerance_ms=None), 101) == ("at 100", True)


def test_a_nearer_one_that_is_far_off_yet_is_not_waited_for() -> None:
    made = joiner(0, 1000, 2000, tolerance_ms=1000)
    assert nearest(made, 2600) == ("at 2000", True)
    assert nearest(made, 2900) == ("at 2000", False)


def test_one_gap_does_not_widen_the_tolerance_and_a_slow_stream_has_a_limit() -> None:
    assert joiner(0, 30, 60, 90, 800, tolerance_ms=None).tolerance_ns == 15 * MS
    assert joiner(0, 900, 1800, tolerance_ms=None).tolerance_ns == 100 * MS


def test_stamps_out_of_order_take_their_place() -> None:
    made = joiner(100, 160, 130)
    assert isinstance(made.find(131 * MS), Partner)
    assert len(made) == 3


def test_what_is_kept_is_bounded_by_time_and_bytes() -> None:
    old = joiner(0, 100, 200, keep_ns=150 * MS)
    assert len(old) == 2
    assert old.dropped == {UNUSED: 1}
    large = joiner(0, 100, 200, budget=MemoryBudget(2 * (100 + ITEM_BYTES)))
    assert len(large) == 2
    assert large.dropped == {CROWDED: 1}
    assert len(joiner(0, 100, budget=MemoryBudget(100 + ITEM_BYTES - 1))) == 0


def test_streams_share_the_room_and_the_one_that_holds_most_gives_way() -> None:
    budget = MemoryBudget(5 * (100 + ITEM_BYTES))
    modest, greedy = joiner(0, 100, budget=budget), joiner(*range(0, 1000, 100), budget=budget)
    assert (len(modest), len(greedy)) == (2, 3)
    assert (modest.dropped, greedy.dropped) == ({}, {CROWDED: 7})
    assert budget.taken == 5 * (100 + ITEM_BYTES)
    greedy.flush()
    modest.flush()
    assert budget.taken == 0


def test_what_was_found_is_not_counted_as_unused() -> None:
    made = joiner(0, 100, keep_ns=150 * MS)
    made.find(0)
    made.keep(200 * MS, "at 200", 1)
    assert not made.dropped


def test_a_clock_that_jumps_back_flushes_what_is_kept() -> None:
    made = joiner(5000, 5100)
    made.keep(4100 * MS, "late", 100)
    assert len(made) == 3
    made.keep(4099 * MS, "of another round", 100)
    assert len(made) == 1
    assert made.dropped == {FLUSHED: 3}
    assert made.find(5000 * MS) == NoPartner(
        "no depth image of its instant: the nearest is 0.901 s before it", final=False
    )


def test_a_stamp_that_is_there_already_is_replaced() -> None:
    made = joiner(100)
    made.keep(100 * MS, "newer", 1)
    found = made.find(100 * MS)
    assert isinstance(found, Partner)
    assert (found.item, len(made), made.dropped) == ("newer", 1, {DOUBLE: 1})


@pytest.mark.parametrize("stamp", [0, 2**63 - 1])
def test_flushing_leaves_nothing(stamp: int) -> None:
    made = joiner(100)
    made.flush()
    assert len(made) == 0
    made.keep(stamp, "any", 1)
    assert isinstance(made.find(stamp), Partner)
