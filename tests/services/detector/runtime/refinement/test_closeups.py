import numpy as np
import pytest
from numpy.typing import NDArray

from services.detector.runtime.candidates import Candidates
from services.detector.runtime.refinement.refiner import FEATURES_SIDE, SIDE, CloseUps, close_ups, own_parts, stretched

IMAGE = np.random.default_rng(1).integers(0, 256, (128, 256, 3), np.uint8)
STEP = 4
SURE_INSIDE = 50.0
"""Log odds at the places of the one prototype that is there where something is."""


def candidates(*boxes: tuple[float, float, float, float], scores: tuple[float, ...] = ()) -> Candidates:
    """Return objects of class 1 whose coarse masks are the prototype."""
    count = len(boxes)
    return Candidates(
        np.array(boxes, np.float32).reshape(-1, 4),
        np.array(scores or [0.9] * count, np.float32),
        np.ones(count, np.int64),
        np.ones((count, 1), np.float32),
    )


def prototype() -> NDArray[np.float32]:
    """Return one that is sure of the image's left half."""
    places = np.full((1, IMAGE.shape[0] // STEP, IMAGE.shape[1] // STEP), -SURE_INSIDE, np.float32)
    places[:, :, : places.shape[2] // 2] = SURE_INSIDE
    return places


def seen(*boxes: tuple[float, float, float, float], scores: tuple[float, ...] = ()) -> CloseUps:
    return close_ups(IMAGE, candidates(*boxes, scores=scores), prototype())


@pytest.mark.parametrize(
    ("box", "window"),
    [
        ((100, 40, 116, 60), (96, 32, 120, 68)),  # a quarter of the box more on each side, to whole places
        ((0, 0, 256, 128), (0, 0, 256, 128)),
        ((240, 100, 256, 128), (236, 92, 256, 128)),
        ((250, 60, 250, 60), (248, 60, 252, 64)),
        ((300, 60, 310, 64), (252, 56, 256, 68)),
    ],
)
def test_a_close_up_shows_an_objects_box_and_what_is_around_it_as_far_as_there_is_an_image(
    box: tuple[float, float, float, float], window: tuple[int, int, int, int]
) -> None:
    (found,) = seen(box).windows.tolist()
    assert tuple(found) == window


def test_it_shows_the_picture_the_coarse_mask_and_the_box() -> None:
    (pixels,) = seen((112, 48, 144, 80)).pixels  # whose window is 104 to 152, 40 to 88
    assert np.array_equal(pixels[..., :3], stretched(IMAGE[40:88, 104:152]))
    middle = pixels[SIDE // 2]
    assert middle[0, 3] == 255
    assert middle[-1, 3] == 0
    assert np.flatnonzero(middle[:, 5]).tolist() == list(range(11, 53))  # pixels whose middle is in the box
    assert set(np.unique(pixels[..., 5]).tolist()) == {0, 255}


def test_it_has_the_models_own_features_at_half_the_side() -> None:
    looks = close_ups(IMAGE, candidates((0, 0, 256, 128)), prototype())
    assert looks.features.shape == (1, FEATURES_SIDE, FEATURES_SIDE, 1)
    assert np.all(looks.features[0, :, : FEATURES_SIDE // 2 - 1] == SURE_INSIDE)
    assert np.all(looks.features[0, :, FEATURES_SIDE // 2 + 1 :] == -SURE_INSIDE)
    assert looks.labels.tolist() == [1]


def test_objects_that_are_surer_are_shown_to_those_after_them() -> None:
    box = (32, 32, 64, 64)
    first, second = seen(box, box).pixels[..., 4]
    assert not first.any()
    assert second[SIDE // 2, SIDE // 2] == 255
    assert second[0, 0] == 0  # outside of the first one's box, whatever its mask says there


def test_objects_that_are_not_sure_hide_nothing() -> None:
    box = (32, 32, 64, 64)
    assert not seen(box, box, scores=(0.24, 0.2)).pixels[..., 4].any()


def test_no_objects_no_close_ups() -> None:
    looks = seen()
    assert looks.pixels.shape == (0, SIDE, SIDE, 6)
    assert looks.windows.shape == (0, 4)


def test_large_windows_are_averaged_and_small_ones_interpolated() -> None:
    checks = np.indices((256, 512)).sum(axis=0).astype(np.uint8) % 2 * 200
    assert np.all(np.abs(stretched(checks).astype(int) - 100) <= 1)
    ramp = np.tile(np.array([0, 255], np.uint8), (2, 1))
    row = stretched(ramp)[0].astype(int)
    assert np.all(np.diff(row) >= 0)
    assert (row[0], row[-1]) == (0, 255)


def test_a_window_may_be_large_one_way_and_small_the_other() -> None:
    columns = np.zeros((3, 640), np.uint8)
    columns[1, ::2] = 200
    square = stretched(columns)
    assert square.shape == (SIDE, SIDE)
    assert np.all(np.abs(square[SIDE // 2].astype(int) - 100) <= 2)


def test_small_parts_of_a_mask_are_an_objects_if_they_reach_into_its_box() -> None:
    mask, inside = np.zeros((SIDE, SIDE), np.bool_), np.zeros((SIDE, SIDE), np.bool_)
    inside[16:48, 16:48] = True
    mask[20:30, 16:46] = mask[32:33, 40:60] = True  # within, and out of it
    mask[50:60, 10:40] = True  # beside it, but large
    expected = mask.copy()
    mask[2:6, 2:6] = True  # beside it
    assert np.array_equal(own_parts(mask, inside), expected)
    assert not own_parts(np.zeros_like(mask), inside).any()
