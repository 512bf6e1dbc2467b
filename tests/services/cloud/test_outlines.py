import numpy as np
import pytest
from numpy.typing import NDArray

from services.cloud.outlines import NEAR_M, RING, Candidates, Masked, RegisteredView, factor_of, trusted, widths_of
from services.cloud.points import Points
from services.geometry.masks import Window
from tests.services.cloud.clouds import xyz_cloud


def numbered(height: int, width: int) -> Points:
    """Return organised points whose y and x say their row and column, 2 m away."""
    rows, columns = np.indices((height, width))
    return Points.of(xyz_cloud(np.stack([columns, rows, np.full_like(rows, 2)], axis=-1)))


def within(points: Points, window: Window, factor: int = 1) -> Candidates:
    (found,) = RegisteredView(points, factor).within([Masked(window, window)])
    return found


def places(found: Candidates) -> list[tuple[int, int]]:
    """Return the rows and columns of points."""
    return [(int(y), int(x)) for x, y, _ in found.points.xyz.T]


def test_the_points_of_a_mask_are_those_of_its_pixels() -> None:
    found = within(numbered(5, 7), Window(2, 3, np.array([[True, False], [True, True]])))
    assert places(found) == [(2, 3), (3, 3), (3, 4)]
    assert found.points.at.tolist() == [17, 24, 25]
    assert found.depth.tolist() == [2, 2, 2]
    assert found.width == 0.5
    assert found.around.tolist() == [2] * (5 * 7 - 3)


def test_what_is_around_a_mask_is_within_reach_of_it_and_in_the_picture() -> None:
    masked = Masked.of(Window(2, 30, blob(3, 4)))
    around = masked.around(40, 60)
    whole = np.zeros((40, 60), np.bool_)
    whole[: 5 + RING, 30 - RING : 34 + RING] = True
    whole[2:5, 30:34] = False
    found = np.zeros_like(whole)
    found[around.place] = around.pixels
    assert np.array_equal(found, whole)


@pytest.mark.parametrize(("top", "left"), [(0, 0), (1, 0), (2, 5), (3, 3), (4, 1)])
@pytest.mark.parametrize("factor", [2, 3])
def test_a_coarser_clouds_points_are_those_in_the_middle_of_its_pixels(top: int, left: int, factor: int) -> None:
    pixels = np.random.default_rng(0).random((7, 6)) < 0.7
    whole = np.zeros((12, 12), np.bool_)
    whole[top : top + 7, left : left + 6] = pixels
    found = within(numbered(12 // factor, 12 // factor), Window(top, left, pixels), factor)
    middle = whole[factor // 2 :: factor, factor // 2 :: factor]
    assert places(found) == [tuple(place) for place in np.argwhere(middle).tolist()]


def test_what_has_no_reading_or_is_behind_the_camera_is_no_candidate() -> None:
    nan = float("nan")
    points = Points.of(xyz_cloud(np.array([[[1, 1, 2], [nan, nan, nan]], [[0, 0, 0], [0, 0, -1]]])))
    found = within(points, Window(0, 0, np.ones((2, 2), np.bool_)))
    assert found.points.at.tolist() == [0]


def test_what_a_sensor_leaves_in_its_memory_is_too_near_to_be_a_candidate() -> None:
    beyond = np.nextafter(np.float32(NEAR_M), np.float32(1))
    points = Points.of(xyz_cloud(np.array([[[1, 1, 1e-42], [1, 1, 1e-9]], [[1, 1, NEAR_M], [1, 1, beyond]]])))
    found = within(points, Window(0, 0, np.ones((2, 2), np.bool_)))
    assert found.points.at.tolist() == [3]


def test_an_empty_mask_has_no_points() -> None:
    found = within(numbered(4, 4), Window(0, 0, np.zeros((0, 0), np.bool_)), 2)
    assert (found.points.at.size, found.points.xyz.shape) == (0, (3, 0))


def blob(height: int, width: int) -> NDArray[np.bool_]:
    return np.ones((height, width), np.bool_)


def test_the_edge_of_a_mask_is_not_trusted_unless_it_is_mostly_edge() -> None:
    assert trusted(Window(3, 4, blob(20, 20))).area == 18 * 18
    assert trusted(Window(3, 4, blob(6, 6))).area == 36
    assert trusted(Window(0, 0, blob(0, 0))).area == 0


@pytest.mark.parametrize(
    ("picture", "cloud", "factor"),
    [
        ((480, 640), (480, 640), 1),
        ((480, 640), (240, 320), 2),
        ((480, 640), (160, 320), 0),
        ((480, 640), (240, 321), 0),
        ((240, 320), (480, 640), 0),
        ((480, 640), (1, 307200), 0),
        ((4, 6), (4, 1), 0),
    ],
)
def test_how_many_pixels_there_are_for_a_point(picture: tuple[int, int], cloud: tuple[int, int], factor: int) -> None:
    points = Points.of(xyz_cloud(np.zeros((*cloud, 3), np.float32)))
    assert factor_of(*picture, points) == factor


def test_objects_are_as_wide_as_they_look_from_the_camera_and_nothing_is_not_wide() -> None:
    points = np.array([[0, 1, -1, 0, 5], [0, 0, 0, 2, 5], [1, 2, 2, 4, 5]], np.float32)
    assert widths_of(points, np.array([0, 0, 3, 4, 4, 5])).tolist() == [0, 1, 0, 0, 0]
    assert widths_of(points[:, :2], np.array([0, 2])).tolist() == [0.5]
    assert widths_of(points[:, :0], np.array([0, 0])).tolist() == [0]
