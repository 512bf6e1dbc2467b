import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Box, Detection
from services.detector.runtime.masks import encode_all
from services.detector.runtime.overlap import NEAR, Comparison, at_border, boxes_of, difference, ious, overlaps
from services.geometry.masks import Window

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


def found(name: str = "box", *, score: float = 0.9, right: float = 100, columns: int = 100) -> Detection:
    """Return an object whose box is 100 pixels high, with a mask of as many columns."""
    (mask,) = encode_all([Window(0, 0, np.ones((100, columns), np.bool_))], 480, 640)
    label = {"box": 0, "pallet": 1}[name]
    return Detection(name=name, score=score, box=Box(0, 0, right, 100), mask=mask, label=label)


def compared(ours: list[Detection], theirs: list[Detection], *, alike: int = 199) -> Comparison:
    """Return a comparison of one picture, and of so many others in which both find the same."""
    comparison = Comparison()
    comparison.add(ours, theirs)
    for _ in range(alike):
        comparison.add([found()], [found()])
    return comparison


def test_two_models_that_find_nearly_the_same_pass() -> None:
    assert compared([found()], [found(right=90, columns=90)]).too_different() is None
    assert compared([found("pallet")], []).too_different() is None
    faint = [found(score=0.3, right=20 * n) for n in range(1, 6)]
    assert compared([found(), *faint], [found()], alike=99).too_different() is None


@pytest.mark.parametrize(
    ("ours", "theirs", "alike", "said"),
    [
        ([found()], [found("pallet")], 1, "of 2 pictures 1 get other classes, at most 1 in 100 may"),
        (
            [found(), found(right=30), found(right=10)],
            [found()],
            97,
            "of 198 clear objects 2 are found by one alone, at most 1 in 100 may",
        ),
        ([found()], [found(), found(right=30)], 1, "of 5 clear objects 1 are found by one alone"),
        ([found()], [found(right=80)], 1, "boxes of the same objects have an IoU of 0.90, not 0.95"),
        ([found()], [found(columns=60)], 1, "masks of the same objects have an IoU of 0.80, not 0.95"),
    ],
)
def test_two_models_that_find_much_else_do_not_pass(
    ours: list[Detection], theirs: list[Detection], alike: int, said: str
) -> None:
    assert (compared(ours, theirs, alike=alike).too_different() or "").startswith(said)


def test_pictures_with_few_objects_are_no_comparison() -> None:
    comparison = compared([found()], [found()], alike=0)
    for _ in range(5):
        comparison.add([], [])
    assert comparison.too_different() == "the model finds objects in 1 of 6 pictures, too few to compare"
