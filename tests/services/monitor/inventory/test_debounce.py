"""Debounced counts."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.monitor.inventory.debounce import Debounce, DebouncedCount
from services.monitor.inventory.sighting import NS

QUICK = Debounce(appear_lists=2, appear_ns=0, vanish_lists=2, vanish_ns=0)


def settled(said: list[int], debounce: Debounce = QUICK, step_ns: int = NS) -> list[int]:
    count = DebouncedCount()
    found = []
    for number, seen in enumerate(said):
        count.advance(seen, number * step_ns, debounce)
        found.append(count.count)
    return found


@pytest.mark.parametrize(
    ("said", "counts"),
    [
        ([1, 0, 1, 0], [0, 0, 0, 0]),
        ([1, 1, 0, 1, 1], [0, 1, 1, 1, 1]),
        ([1, 1, 0, 0], [0, 1, 1, 0]),
        ([3, 2, 2], [0, 2, 2]),
        ([1, 2, 3, 4], [0, 1, 2, 3]),
        ([2, 2, 1, 0, 0], [0, 2, 2, 1, 0]),
        ([2, 2, 5, 2, 0, 2], [0, 2, 2, 2, 2, 2]),
        ([2, 2, 1, 3, 1, 3], [0, 2, 2, 2, 2, 2]),
    ],
)
def test_one_list_alone_moves_nothing(said: list[int], counts: list[int]) -> None:
    assert settled(said) == counts


@pytest.mark.parametrize(("step_ns", "counts"), [(NS // 2, [1, 1, 0]), (NS // 2 - 1, [1, 1, 1])])
def test_time_counts_beside_lists(step_ns: int, counts: list[int]) -> None:
    long = Debounce(appear_lists=1, appear_ns=0, vanish_lists=2, vanish_ns=NS)
    assert settled([1, 0, 0, 0], long, step_ns)[1:] == counts


def test_the_run_is_dated_by_its_first_list() -> None:
    count = DebouncedCount()
    assert not count.advance(1, 5, QUICK)
    assert count.advance(1, 7, QUICK)
    assert count.since_ns == 5


def test_a_clock_that_is_set_back_begins_the_run_anew() -> None:
    count = DebouncedCount(1)
    long = Debounce(vanish_lists=2, vanish_ns=NS)
    assert not count.advance(0, 3600 * NS, long)
    assert not count.advance(0, 0, long)
    assert count.advance(0, NS, long)


@given(st.lists(st.integers(0, 5), max_size=30), st.integers(1, 4), st.integers(1, 4))
def test_the_count_was_said_by_as_many_lists_as_it_takes(said: list[int], appear: int, vanish: int) -> None:
    counts = [0, *settled(said, Debounce(appear, 0, vanish, 0))]
    for number, (before, after) in enumerate(pairwise(counts), 1):
        if after > before:
            assert min(said[number - appear : number]) == after
        if after < before:
            assert max(said[number - vanish : number]) == after
