import msgspec
import pytest

from schemas.detections import Box, Detection
from services.detector.runtime.overlap import difference

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
