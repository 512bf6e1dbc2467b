import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.detector.tracking.camera_motion import LEAST_SIDE, Motion, leap, moved

HEIGHT, WIDTH = 120, 160


def wall(height: int = 240, width: int = 480, grain: int = 8) -> NDArray[np.uint8]:
    """Return a grey picture with corners to hold on to."""
    coarse = np.random.default_rng(1).integers(0, 255, (height // grain, width // grain), np.uint8)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


def view(left: int, top: int = 60) -> NDArray[np.uint8]:
    return np.ascontiguousarray(wall()[top : top + HEIGHT, left : left + WIDTH])


@pytest.mark.parametrize("right", [-60, -20, 0, 20, 60])
def test_how_far_a_picture_leaps(right: int) -> None:
    assert leap(view(160), view(160 - right)) == pytest.approx((right, 0), abs=4)


def test_a_picture_without_anything_to_see_leaps_nowhere() -> None:
    dark = np.zeros((HEIGHT, WIDTH), np.uint8)
    assert leap(dark, dark) == (0, 0)


@pytest.mark.parametrize(("right", "down"), [(-50, 0), (3, 2), (0, -5), (45, 4)])
def test_boxes_move_with_the_picture(right: int, down: int) -> None:
    motion = Motion()
    assert motion.look(view(160)) is None
    flow = motion.look(view(160 - right, 60 - down))
    assert flow is not None
    box = np.array([[60.0, 40.0, 90.0, 70.0]])
    assert moved(box, flow, 1.0)[0] == pytest.approx(box[0] + [right, down, right, down], abs=1.5)
    assert moved(4 * box, flow, 0.25)[0] == pytest.approx(4 * (box[0] + [right, down, right, down]), abs=6)


def test_each_box_moves_with_what_is_in_it() -> None:
    flow = np.zeros((HEIGHT, WIDTH, 2))
    flow[:, :80] = (10, 0)
    flow[:, 80:] = (0, -5)
    boxes = np.array([[10.0, 10, 50, 30], [100, 60, 140, 90]])
    assert moved(boxes, flow, 1.0).tolist() == [[20, 10, 60, 30], [100, 55, 140, 85]]


def test_a_box_grows_with_what_is_in_it_if_that_can_be_told() -> None:
    across, down = np.meshgrid(np.arange(WIDTH) - 80.0, np.arange(HEIGHT) - 60.0)
    flow = np.stack([0.2 * across, 0.2 * down], axis=2)
    large, tiny = moved(np.array([[59.0, 39, 101, 81], [79, 59, 81, 61]]), flow, 1.0)
    assert large == pytest.approx([55, 35, 105, 85], abs=1.5)
    assert tiny[2:] - tiny[:2] == pytest.approx([2, 2])


def test_a_box_beyond_the_border_moves_with_what_is_nearest_to_it() -> None:
    flow = np.full((HEIGHT, WIDTH, 2), (7.0, 0.0))
    assert moved(np.array([[-40.0, 10, -20, 30]]), flow, 1.0).tolist() == [[-33, 10, -13, 30]]
    assert moved(np.zeros((0, 4)), flow, 1.0).shape == (0, 4)


def test_another_size_begins_anew_and_a_tiny_picture_says_nothing() -> None:
    motion, tiny = Motion(), np.zeros((LEAST_SIDE - 1, WIDTH), np.uint8)
    flat = np.zeros((LEAST_SIDE, WIDTH), np.uint8)
    assert [motion.look(each) is None for each in (flat, flat, view(0), tiny, tiny, view(0), view(0))] == [
        *(True, False),
        *(True, True, True, True, False),
    ]


def test_nothing_moves_in_a_dark_picture() -> None:
    motion, dark = Motion(), np.zeros((HEIGHT, WIDTH), np.uint8)
    motion.look(dark)
    flow = motion.look(dark)
    assert flow is not None
    assert not flow.any()
