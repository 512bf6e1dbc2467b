import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Box, Detection
from services.detector.runtime.overlap import NEAR, at_border, boxes_of, difference, ious, overlaps

SIZE = (640, 480)
INSIDE = np.zeros((1, 4), np.bool_)


def boxes(*corners: tuple[float, float, float, float]) -> NDArray[np.float64]:
    return np.array(corners, np.float64).reshape(-1, 4)


def test_ious_of_the_boxes_of_objects() -> None:
    some = boxes_of([Detection(name="box", score=1, box=Box(*corners)) for corners in ((0, 0, 20, 10), (5, 5, 5, 5))])
    assert ious(some, some).tolist() == [[1, 0], [0, 0]]
    assert ious(some, boxes((10, 0, 30, 10))).tolist() == [[pytest.approx(1 / 3)], [0]]
    assert (ious(boxes_of([]), some).shape, ious(some, boxes_of([])).shape) == ((0, 2), (2, 0))


def test_which_sides_the_border_may_have_cut() -> None:
    sides = at_border(boxes((NEAR, NEAR + 0.1, 640 - NEAR, 480 - NEAR - 0.1), (0, 0, 640, 480)), SIZE)
    assert sides.tolist() == [[True, False, True, False], [True] * 4]


def test_the_overlap_of_boxes_in_the_image_is_their_iou() -> None:
    found = overlaps(boxes((10, 10, 30, 30)), boxes((10, 10, 30, 30), (20, 10, 40, 30), (50, 50, 60, 60)), INSIDE, SIZE)
    assert found[0] == pytest.approx([1, 1 / 3, 0])


def test_what_of_a_box_is_out_of_the_image_does_not_count() -> None:
    assert overlaps(boxes((-30, 10, 10, 30)), boxes((0, 10, 10, 30)), INSIDE, SIZE)[0, 0] == 1
    assert overlaps(boxes((-30, 10, -10, 30)), boxes((0, 10, 10, 30)), INSIDE, SIZE)[0, 0] == 0


@pytest.mark.parametrize(
    ("cut", "now", "then"),
    [
        ((True, False, False, False), (100, 50, 120, 90), (20, 50, 120, 90)),
        ((False, True, False, False), (100, 50, 120, 90), (100, 10, 120, 90)),
        ((False, False, True, False), (500, 50, 520, 90), (500, 50, 600, 90)),
        ((False, False, False, True), (100, 300, 120, 320), (100, 300, 120, 450)),
    ],
)
def test_what_comes_into_view_where_the_border_cut_a_box_belongs_to_it(
    cut: tuple[bool, ...], now: tuple[float, float, float, float], then: tuple[float, float, float, float]
) -> None:
    assert overlaps(boxes(now), boxes(then), np.array([cut]), SIZE)[0, 0] == 1
    assert overlaps(boxes(now), boxes(then), INSIDE, SIZE)[0, 0] <= 0.5


def test_nothing_on_nothing() -> None:
    none = boxes()
    assert overlaps(none, boxes((0, 0, 1, 1)), np.zeros((0, 4), np.bool_), SIZE).shape == (0, 1)
    assert overlaps(boxes((0, 0, 1, 1)), none, INSIDE, SIZE).shape == (1, 0)
    assert overlaps(boxes((5, 5, 5, 5)), boxes((5, 5, 5, 5)), INSIDE, SIZE)[0, 0] == 0


OURS = Detection(name="box", score=0.6, box=Box(0, 0, 100, 10), label=0)


def other(**fields: object) -> Detection:
    return msgspec.structs.replace(OURS, **fields)


@pytest.mark.parametrize("theirs", [OURS, other(score=0.6499), other(score=0.5501), other(box=Box(0, 0, 90, 10))])
def test_rounding_is_no_difference(theirs: Detection) -> None:
    assert difference([OURS], [theirs], 0.25) is None


@pytest.mark.parametrize(
    "theirs", [other(score=0.6501), other(score=0.5499), other(box=Box(0, 0, 89.9, 10)), other(label=1)]
)
def test_more_than_rounding_is_said_of_both_sides_and_of_the_surest(theirs: Detection) -> None:
    surest = max(OURS.score, theirs.score)
    said = f"2 of 1 and 1 objects, such as a box of score {surest:.2f}"
    assert difference([OURS], [theirs], 0.25) == said
    assert difference([theirs], [OURS], 0.25) == said


@pytest.mark.parametrize(("confidence", "differs"), [(0.55, False), (0.549, True)])
def test_what_is_hardly_sure_enough_may_be_found_by_one_alone(confidence: float, *, differs: bool) -> None:
    assert (difference([OURS], [], confidence) is not None) is differs
    assert (difference([], [OURS], confidence) is not None) is differs


def test_nothing_is_nothing() -> None:
    assert difference([], [], 0.25) is None
