import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.cloud.outliers import Selection, crowded, foreground

RNG = np.random.default_rng(3)


def plane(depth: float, count: int, *, width: float = 1.0, noise: float = 0.004) -> NDArray[np.float32]:
    """Return points facing the camera: (3, count)."""
    x, y = RNG.uniform(-width / 2, width / 2, (2, count))
    return np.stack([x, y, depth + noise * RNG.standard_normal(count)]).astype(np.float32)


def front(*surfaces: NDArray[np.float32]) -> list[float]:
    """Return the share of each surface that is taken for the object."""
    points = np.concatenate(surfaces, axis=1)
    kept = foreground(points[2], points[:2])
    bounds = np.cumsum([surface.shape[1] for surface in surfaces])[:-1]
    return [float(part.mean()) for part in np.split(kept, bounds)]


def test_one_surface_is_kept_whole() -> None:
    assert front(plane(3, 1000)) == [1.0]


@pytest.mark.parametrize("share", [0.3, 1.0, 2.5])
def test_what_shows_behind_an_object_is_left_out_even_where_it_is_most_of_the_mask(share: float) -> None:
    kept, behind = front(plane(3, 1000), plane(6, int(1000 * share)))
    assert (kept, behind) == (1.0, 0.0)


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
    assert foreground(depth, np.zeros((2, 2000), np.float32)).all()


@given(st.lists(st.floats(2**-20, 2**13, width=32), min_size=1, max_size=50))
def test_something_is_always_the_foreground(depths: list[float]) -> None:
    depth = np.array(depths, np.float32)
    kept: Selection = foreground(depth, np.zeros((2, len(depth)), np.float32))
    assert kept.shape == depth.shape
    assert kept.any()


def test_points_that_stand_alone_are_outliers() -> None:
    alone = np.array([[0, 3, 0.5], [4, 0, 0], [3, 3, 8]], np.float32)
    kept = crowded(np.concatenate([plane(3, 2000), alone], axis=1))
    assert kept[:2000].all()
    assert not kept[2000:].any()


def test_two_together_are_outliers_and_three_are_not() -> None:
    far = [[5.0, 5.0, 9.0]]
    for count, kept in ((2, False), (3, True)):
        points = np.concatenate([plane(3, 1000), np.array(far * count, np.float32).T], axis=1)
        assert crowded(points)[1000:].tolist() == [kept] * count


@pytest.mark.parametrize("count", [1, 3])
def test_points_in_one_place_are_each_others_neighbours(count: int) -> None:
    assert crowded(np.ones((3, count), np.float32)).tolist() == [count >= 3] * count


def test_depths_that_are_spread_over_every_step_have_a_foreground_too() -> None:
    rng = np.random.default_rng(1)
    depth = np.exp(rng.uniform(np.log(0.05), np.log(9000), 20_000)).astype(np.float32)
    across = rng.normal(0, 1, (2, 20_000)).astype(np.float32)
    assert foreground(depth, across).any()
