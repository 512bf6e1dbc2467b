import numpy as np
import pytest
from numpy.typing import NDArray

from services.geometry.foreground import foreground, has_own_depth, on_surface
from services.geometry.masks import Window

Depths = NDArray[np.float64]
RNG = np.random.default_rng(3)


def seen(*surfaces: tuple[float, int], noise: float = 0.005) -> Depths:
    return np.sort(np.concatenate([RNG.normal(z, noise, count) for z, count in surfaces]))[np.newaxis]


def kept(within: Depths, around: Depths) -> tuple[float, float]:
    own = within[foreground(within, around)]
    return float(own.min()), float(own.max())


def test_one_surface_is_all_of_it_whatever_is_around() -> None:
    within = seen((2.0, 512))
    for around in (seen((2.0, 512)), seen((4.0, 512)), np.full((1, 512), np.nan)):
        assert foreground(within, around).all()


def test_background_through_gaps_is_left_out_even_where_there_is_more_of_it() -> None:
    assert kept(seen((2.0, 200), (4.0, 312)), seen((4.0, 500), (2.0, 12))) == pytest.approx((2, 2), abs=0.05)


def test_what_hides_a_part_of_the_object_is_left_out() -> None:
    assert kept(seen((1.0, 150), (3.0, 362)), seen((1.0, 400), (6.0, 112))) == pytest.approx((3, 3), abs=0.05)


def test_an_object_of_two_parts_is_kept_whole() -> None:
    assert kept(seen((2.0, 200), (3.0, 312)), seen((6.0, 512))) == pytest.approx((2, 3), abs=0.05)


def test_flying_pixels_between_two_surfaces_are_neither() -> None:
    flying = np.sort(np.concatenate([seen((2.0, 400), (5.0, 92))[0], RNG.uniform(2.1, 4.9, 20)]))[np.newaxis]
    assert kept(flying, seen((5.0, 512))) == pytest.approx((2, 2), abs=0.1)


def test_surfaces_that_all_go_on_outside_are_all_kept() -> None:
    assert foreground(seen((2.0, 256), (4.0, 256)), seen((2.0, 260), (4.0, 252))).all()


def test_readings_that_form_no_surface_are_all_kept() -> None:
    assert foreground(np.geomspace(1, 10_000, 512)[np.newaxis], seen((2.0, 512))).all()


def test_objects_are_judged_each_by_itself() -> None:
    within = np.concatenate([seen((2.0, 512)), seen((2.0, 256), (4.0, 256))])
    around = np.concatenate([seen((2.0, 512)), seen((4.0, 512))])
    assert foreground(within, around).sum(axis=1).tolist() == [512, 256]


def test_what_is_sparse_counts_where_nothing_is_foreign() -> None:
    sparse = np.sort(np.concatenate([seen((2.0, 400), (2.6, 92))[0], RNG.uniform(2.1, 2.5, 20)]))[np.newaxis]
    assert foreground(sparse, seen((6.0, 512))).all()


def test_what_lies_between_surfaces_is_on_none() -> None:
    within = np.sort(np.concatenate([seen((2.0, 400), (5.0, 92))[0], RNG.uniform(2.2, 4.7, 20)]))[np.newaxis]
    solid = within[0, on_surface(within)[0]]
    assert len(solid) == 492
    assert not ((solid > 2.1) & (solid < 4.9)).any()


@pytest.mark.parametrize("count", [1, 2, 512])
def test_equal_readings_are_all_on_a_surface(count: int) -> None:
    assert on_surface(np.full((2, max(count, 2)), 3.0)).all()


NAN = float("nan")
BOX = np.s_[20:60, 30:70]


def floor() -> Depths:
    """Return a floor that ends at a wall: nearer further down."""
    return np.minimum(4.0, 120 / np.arange(10, 90))[:, np.newaxis].repeat(100, axis=1)


def window(rows: slice, columns: slice) -> Window:
    pixels = np.zeros((80, 100), np.bool_)
    pixels[rows, columns] = True
    return Window(0, 0, pixels)


def widened(pixels: int) -> Window:
    rows, columns = BOX
    return window(slice(rows.start - pixels, rows.stop + pixels), slice(columns.start - pixels, columns.stop + pixels))


@pytest.mark.parametrize("too_large", [1, 2, 3, 5, 8, 12])
def test_an_object_that_gives_no_depth_has_none_of_its_own_however_much_too_large_its_mask_is(too_large: int) -> None:
    depth = floor()
    depth[BOX] = NAN
    assert not has_own_depth(widened(too_large), depth)
    depth[BOX] = 1.6
    assert has_own_depth(widened(too_large), depth)


def test_readings_of_its_rim_alone_are_its_own_where_they_do_not_go_on_outside() -> None:
    depth = floor()
    depth[BOX] = 1.6
    depth[23:57, 33:67] = NAN
    assert has_own_depth(window(*BOX), depth)


def test_readings_in_its_middle_are_its_own_also_where_they_go_on_outside() -> None:
    assert has_own_depth(window(*BOX), np.full((80, 100), 3.0))
    scattered = np.where(RNG.random((80, 100)) < 0.1, 3.0, NAN)
    assert has_own_depth(window(*BOX), scattered)


def test_without_a_reading_around_the_mask_its_readings_are_its_own() -> None:
    depth = np.full((80, 100), NAN)
    depth[20:23, 30:70] = 3.0
    assert has_own_depth(window(*BOX), depth)


def test_where_the_image_ends_is_no_rim() -> None:
    depth = floor()
    at_end = np.s_[60:80, 30:70]
    depth[at_end] = NAN
    depth[76:, 30:70] = 1.0
    assert has_own_depth(window(*at_end), depth)
    depth[76:, 30:70] = NAN
    depth[60:63, 30:70] = floor()[60:63, 30:70]
    assert not has_own_depth(window(*at_end), depth)


def test_of_a_thin_mask_the_innermost_pixels_are_no_rim() -> None:
    depth = np.full((80, 100), 4.0)
    thin = window(slice(20, 70), slice(40, 45))
    depth[20:70, 41:44] = NAN
    assert not has_own_depth(thin, depth)
    depth[20:70, 41:44] = 2.0
    assert has_own_depth(thin, depth)
