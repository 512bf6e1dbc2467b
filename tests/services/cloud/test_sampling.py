import numpy as np
import pytest

from services.cloud.points import some, spread


@pytest.mark.parametrize("count", [0, 1, 99, 100])
def test_few_enough_are_all_taken(count: int) -> None:
    assert some(count, 100).tolist() == list(range(count))


@pytest.mark.parametrize("count", [101, 150, 1000, 10_007, 1_000_000])
def test_of_more_no_more_than_wanted_are_taken_each_once_from_all_over(count: int) -> None:
    taken = some(count, 100)
    assert 60 <= len(taken) <= 100
    assert (np.diff(taken) > 0).all()
    assert taken[0] < count / 25
    assert count * 24 / 25 < taken[-1] < count


def test_rows_of_points_are_not_thinned_to_a_column() -> None:
    assert len(set((some(100 * 64, 100) % 64).tolist())) > 40


def test_ranges_are_spread_over_as_one_alone_is() -> None:
    counts = np.array([7, 1, 5000])
    taken = spread(counts, 100)
    assert taken.shape == (3, 100)
    for row, count, start in zip(taken, counts.tolist(), (0, 7, 8), strict=True):
        assert np.array_equal(row - start, spread(np.array([count]), 100)[0])
    assert set(taken[0].tolist()) == set(range(7))
    assert taken[1].tolist() == [7] * 100
    assert np.array_equal(taken[2] - 8, some(5000, 100))
