import numpy as np
import pytest
from numpy.typing import NDArray

from services.distance.depth_readings import AROUND, RING, SAMPLE, Criteria, Picked, pick
from services.geometry.depth import Depth
from services.geometry.masks import Window, decode
from tests.schemas.masks import coco_mask

HEIGHT, WIDTH = 40, 60
NEAR, FAR = slice(10, 20), slice(30, 50)


def windows_of(*places: tuple[slice, slice]) -> list[Window]:
    masks = np.zeros((len(places), HEIGHT, WIDTH), np.bool_)
    for mask, place in zip(masks, places, strict=True):
        mask[place] = True
    return [decode(coco_mask(mask), margin=RING) for mask in masks]


def picked(depth_m: NDArray[np.float32], *, edge: int = 0) -> Picked:
    return pick(windows_of((NEAR, NEAR), (NEAR, FAR), (slice(0, 4), slice(0, 5))), Depth(depth_m), Criteria(30, edge))


def ramp() -> NDArray[np.float32]:
    return np.linspace(1, 3, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)


def test_readings_are_the_masks_own_ascending_with_their_places() -> None:
    depth_m = ramp()
    found = picked(depth_m)
    assert found.areas.tolist() == found.counts.tolist() == [100, 200, 20]
    assert found.rows.tolist() == [0, 1]
    assert found.z.shape == found.at.shape == (2, SAMPLE)
    assert np.array_equal(depth_m.ravel()[found.at], found.z)
    assert (np.diff(found.z, axis=1) >= 0).all()
    for at, columns in zip(found.at, (NEAR, FAR), strict=True):
        assert set(at.tolist()) <= set(np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)[NEAR, columns].ravel().tolist())
    assert np.allclose(found.mean_m[:2], [depth_m[NEAR, columns].mean(dtype=np.float64) for columns in (NEAR, FAR)])


@pytest.mark.parametrize(("height", "width"), [(240, 320), (480, 640), (720, 1280)])
@pytest.mark.parametrize(
    ("high", "wide", "rim"),
    [
        *((side, side, 3) for side in (10, 12)),
        *((side, side, 5) for side in (20, 30)),
        *((side, side, 6) for side in (24, 42)),
        *((side, side, 8) for side in (30, 66, 100)),
        *((200, 5, 2), (200, 7, 3), (200, 8, 3), (200, 20, 5), (200, 40, 8)),
    ],
)
def test_a_black_object_is_not_told_the_walls_distance_in_an_image_of_any_size(
    height: int, width: int, high: int, wide: int, rim: int
) -> None:
    """Its mask is `rim` pixels too large on each side, as at the width of one cell of a model's prototypes."""
    mask = np.zeros((height, width), np.bool_)
    mask[20 : 20 + high, 100 : 100 + wide] = True
    depth_m = np.full((height, width), 5, np.float32)
    depth_m[20 + rim : 20 + high - rim, 100 + rim : 100 + wide - rim] = np.nan
    window = decode(coco_mask(mask), margin=RING)
    assert pick([window], Depth(depth_m), Criteria()).own.tolist() == [False]
    depth_m[mask] = 2
    depth_m[20 : 20 + high : 4, 100 : 100 + wide : 2] = np.nan  # an eighth of it, as noise takes readings
    assert pick([window], Depth(depth_m), Criteria()).own.tolist() == [True]


def test_what_is_around_is_within_the_ring_and_not_of_the_mask() -> None:
    depth_m = np.full((HEIGHT, WIDTH), 9, np.float32)
    depth_m[NEAR, NEAR] = 1
    depth_m[NEAR.start - RING : NEAR.stop + RING, NEAR.start - RING : NEAR.stop + RING] += 1
    around = picked(depth_m).around
    assert around.shape == (2, AROUND)
    assert (around[0] == 10).all()


def test_without_a_reading_around_there_is_none() -> None:
    depth_m = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    depth_m[NEAR, NEAR] = 2
    found = picked(depth_m)
    assert (found.rows.tolist(), found.counts.tolist()) == ([0], [100, 0, 0])
    assert np.isnan(found.around).all()
    assert found.mean_m.tolist() == [2, 0, 0]


def test_pixels_beside_a_reading_take_it_and_those_far_from_one_none() -> None:
    depth_m = ramp() + 5  # around the object: else what it reads at its edge would be taken for that
    depth_m[NEAR, FAR] -= 5
    depth_m[NEAR, 30:45] = np.nan
    found = picked(depth_m)
    columns = found.at[1] % WIDTH
    assert columns.min() == 45
    assert (columns == 45).mean() > (columns == 47).mean()


def test_an_edge_is_taken_off_where_enough_is_left() -> None:
    depth_m = ramp()
    columns = picked(depth_m, edge=3).at % WIDTH
    assert (columns[0].min(), columns[0].max()) == (10, 19)
    assert (columns[1].min(), columns[1].max()) == (33, 46)


@pytest.mark.parametrize("height", [64, 128, 256, 512])
def test_readings_are_from_all_over_a_mask_whatever_its_shape(height: int) -> None:
    mask = np.zeros((height + 20, WIDTH), np.bool_)
    mask[10:-10, FAR] = True
    found = pick([decode(coco_mask(mask), margin=RING)], Depth(np.ones(mask.shape, np.float32)), Criteria())
    rows, columns = np.divmod(found.at[0], WIDTH)
    assert len(set(columns.tolist())) >= 15
    assert np.bincount(columns).max() < 2.5 * SAMPLE / 20
    assert rows.min() <= 10 + height / 64 <= height - height / 64 <= rows.max()


@pytest.mark.parametrize("height", [30, 300, 301, 302, 417, 600])
def test_the_middle_of_the_readings_is_that_of_the_mask_whatever_its_height(height: int) -> None:
    mask = np.zeros((height + 20, 920), np.bool_)
    mask[10:-10, 10:-10] = True
    found = pick([decode(coco_mask(mask), margin=RING)], Depth(np.ones(mask.shape, np.float32)), Criteria())
    rows, columns = np.divmod(found.at[0], 920)
    assert rows.mean() == pytest.approx((height + 19) / 2, abs=0.5)
    assert columns.mean() == pytest.approx(459.5, abs=0.5)


def test_where_no_object_has_enough_there_is_nothing() -> None:
    found = picked(np.full((HEIGHT, WIDTH), np.nan, np.float32))
    assert found.counts.tolist() == [0, 0, 0]
    assert found.z.shape == (0, SAMPLE)


def test_an_objects_readings_are_never_those_of_the_next_one() -> None:
    depth_m = np.full((HEIGHT, WIDTH), 2, np.float32)
    first, second = (slice(20, HEIGHT), slice(40, WIDTH)), (slice(0, 20), slice(0, 20))
    depth_m[HEIGHT - 1, WIDTH - 2 :] = np.nan  # the last of the first one's pixels; the second begins with readings
    depth_m[second] = 5
    found = pick(windows_of(first, second), Depth(depth_m), Criteria())
    assert found.rows.tolist() == [0, 1]
    assert found.z[0].tolist() == [2] * SAMPLE
    assert found.z[1].tolist() == [5] * SAMPLE
    rows, columns = np.divmod(found.at[0], WIDTH)
    assert rows.min() >= 20
    assert columns.min() >= 40
