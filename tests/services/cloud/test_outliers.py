import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.cloud.outliers import crowded, own

RNG = np.random.default_rng(3)
NOTHING = np.zeros(0, np.float32)


def plane(depth: float, count: int, *, width: float = 1.0, noise: float = 0.004) -> NDArray[np.float32]:
    """Return points facing the camera: (3, count)."""
    x, y = RNG.uniform(-width / 2, width / 2, (2, count))
    return np.stack([x, y, depth + noise * RNG.standard_normal(count)]).astype(np.float32)


def front(*surfaces: NDArray[np.float32], around: NDArray[np.float32] = NOTHING) -> list[float]:
    """Return the share of each surface that is taken for the object."""
    points = np.concatenate(surfaces, axis=1)
    width = max(float(np.ptp(surface[0] / surface[2])) for surface in surfaces)
    (chosen,) = own([points[2]], np.array([width], np.float32), [around])
    kept = np.ones(points.shape[1], np.bool_) if chosen is None else chosen
    bounds = np.cumsum([surface.shape[1] for surface in surfaces])[:-1]
    return [float(part.mean()) for part in np.split(kept, bounds)]


def test_one_surface_is_kept_whole() -> None:
    points = plane(3, 1000)
    assert own([points[2]], np.array([0.3], np.float32), [NOTHING]) == [None]


@pytest.mark.parametrize("share", [0.3, 1.0, 2.5])
def test_what_shows_behind_an_object_is_left_out_even_where_it_is_most_of_the_mask(share: float) -> None:
    kept, behind = front(plane(3, 1000), plane(6, int(1000 * share)))
    assert (kept, behind) == (1.0, 0.0)


def test_what_shows_behind_an_object_and_around_it_is_left_out() -> None:
    kept, behind = front(plane(3, 1000), plane(6, 1000), around=np.full(300, 6, np.float32))
    assert (kept, behind) == (1.0, 0.0)


def test_what_lies_behind_but_not_around_is_a_part_of_what_something_splits() -> None:
    assert front(plane(3, 1000), plane(6, 400), around=np.full(300, 1.5, np.float32)) == [1.0, 1.0]


def test_what_is_around_the_mask_more_than_in_it_is_something_before_the_object() -> None:
    around = np.full(300, 1.5, np.float32)
    before, kept = front(plane(1.5, 300), plane(3, 1000), around=around)
    assert (before, kept) == (0.0, 1.0)


def test_things_of_its_own_distance_beside_an_object_take_nothing_from_it() -> None:
    around = np.concatenate([np.full(200, 3), np.full(100, 6)]).astype(np.float32)
    assert front(plane(3, 1000), plane(6, 100), around=around) == [1.0, 0.0]
    assert front(plane(3, 1000), around=np.full(300, 3, np.float32)) == [1.0]


def test_what_is_no_reading_around_an_object_says_nothing() -> None:
    around = np.array([np.nan, np.inf, 0, -1], np.float32)
    assert front(plane(3, 1000), plane(6, 1000), around=around) == [1.0, 0.0]


def test_a_little_in_front_of_an_object_is_not_the_object() -> None:
    before, kept = front(plane(1.5, 100), plane(3, 1000))
    assert (before, kept) == (0.0, 1.0)


def test_a_mast_before_its_cabin_is_one_object() -> None:
    mast, cabin, wall = front(plane(4, 400, width=1.2), plane(4.3, 600, width=1.2), plane(6, 300, width=1.2))
    assert (mast, cabin, wall) == (1.0, 1.0, 0.0)


def test_a_small_thing_before_a_wall_has_none_of_it() -> None:
    thing, wall = front(plane(4, 400, width=0.3), plane(4.3, 600, width=0.3))
    assert (thing, wall) == (1.0, 0.0)


def test_edges_where_two_depths_are_mixed_join_no_surfaces() -> None:
    kept, behind, _ = front(plane(3, 1000), plane(6, 1000), plane(4.5, 20, noise=0.8))
    assert (kept, behind) == (1.0, 0.0)


def test_a_slope_is_one_surface() -> None:
    depth = np.linspace(2, 6, 2000, dtype=np.float32)
    assert own([depth], np.zeros(1, np.float32), [NOTHING]) == [None]


readings = st.lists(st.floats(2**-20, 2**13, width=32), min_size=1, max_size=50)


@given(readings, st.lists(st.floats(width=32), max_size=20))
def test_something_is_always_the_foreground(depths: list[float], around: list[float]) -> None:
    depth = np.array(depths, np.float32)
    (kept,) = own([depth], np.ones(1, np.float32), [np.array(around, np.float32)])
    assert kept is None or (kept.shape == depth.shape and kept.any())


@given(st.lists(st.tuples(readings, st.lists(st.floats(1, 100, width=32), max_size=20)), min_size=2, max_size=4))
def test_an_objects_foreground_is_the_same_whatever_else_is_in_the_picture(
    objects: list[tuple[list[float], list[float]]],
) -> None:
    depths, around = ([np.array(each[at], np.float32) for each in objects] for at in (0, 1))
    widths = np.linspace(0, 1, len(objects), dtype=np.float32)
    together = own(depths, widths, around)
    for number, mine in enumerate(together):
        (alone,) = own([depths[number]], widths[number : number + 1], [around[number]])
        if alone is None or mine is None:
            assert alone is mine
        else:
            assert np.array_equal(alone, mine)


def test_of_no_objects_there_is_nothing() -> None:
    assert own([], np.zeros(0, np.float32), []) == []
    assert crowded([]) == []


def neighbours(points: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return which points of a single object have some."""
    (kept,) = crowded([points])
    return np.ones(points.shape[1], np.bool_) if kept is None else kept


def test_points_that_stand_alone_are_outliers() -> None:
    alone = np.array([[0, 3, 0.5], [4, 0, 0], [3, 3, 8]], np.float32)
    kept = neighbours(np.concatenate([plane(3, 2000), alone], axis=1))
    assert kept[:2000].all()
    assert not kept[2000:].any()


def test_two_together_are_outliers_and_three_are_not() -> None:
    far = [[5.0, 5.0, 9.0]]
    for count, kept in ((2, False), (3, True)):
        points = np.concatenate([plane(3, 1000), np.array(far * count, np.float32).T], axis=1)
        assert neighbours(points)[1000:].tolist() == [kept] * count


@pytest.mark.parametrize("count", [1, 3])
def test_points_in_one_place_are_each_others_neighbours(count: int) -> None:
    assert neighbours(np.ones((3, count), np.float32)).tolist() == [count >= 3] * count


def test_points_of_another_object_are_no_neighbours() -> None:
    alone, together = crowded([plane(3, 2), plane(3, 1000)])
    assert alone is not None
    assert not alone.any()
    assert together is None
    assert neighbours(plane(3, 1000)).all()


def test_depths_that_are_spread_over_every_step_have_a_foreground_too() -> None:
    rng = np.random.default_rng(1)
    depth = np.exp(rng.uniform(np.log(0.05), np.log(9000), 20_000)).astype(np.float32)
    (kept,) = own([depth], np.ones(1, np.float32), [NOTHING])
    assert kept is None or kept.any()
