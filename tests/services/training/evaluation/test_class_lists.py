import pytest

from schemas.detections import Detection
from services.training.evaluation.class_lists import ListFigures, ListScore
from services.training.evaluation.truths import Truth
from tests.services.training.evaluation.pictures import found, truth

PLACE = (0, 0, 20, 20)
REQUIRED = (0, 0, 60, 1)  # 0.3 % of the picture
VISIBLE = (0, 0, 11, 1)  # just more than 0.05 %


def figures(truths: list[Truth], *detections: Detection, confidence: float = 0.35) -> ListFigures:
    score = ListScore()
    score.add(truths, detections)
    return score.figures(confidence)


@pytest.mark.parametrize(
    ("seen", "listed", "exact"),
    [
        ([], [], True),
        ([truth("box", *REQUIRED)], ["box"], True),
        ([truth("box", *REQUIRED)], [], False),
        ([truth("box", *REQUIRED, visibility=0.5)], [], False),
        ([truth("box", *REQUIRED, visibility=0.49)], [], True),
        ([truth("box", *REQUIRED, visibility=0.49)], ["box"], True),
        ([truth("box", 0, 0, 59, 1)], [], True),
        ([truth("box", *VISIBLE)], ["box"], True),
        ([truth("box", 0, 0, 10, 1)], ["box"], False),
        ([truth("box", 0, 0, 10, 1), truth("box", 0, 5, 10, 6)], ["box"], False),
        ([truth("box", *REQUIRED)], ["box", "pallet"], False),
        ([truth("box", *REQUIRED), truth("pallet", *REQUIRED)], ["box", "box"], False),
    ],
)
def test_a_list_is_right_with_all_that_must_and_none_that_cannot_be_there(
    seen: list[Truth], listed: list[str], *, exact: bool
) -> None:
    assert figures(seen, *(found(name, *PLACE) for name in listed)).exact == exact


def test_what_was_wrong_is_counted_by_class() -> None:
    score = ListScore()
    for _ in range(2):
        score.add([truth("box", *REQUIRED)], [found("forklift", *PLACE)])
    score.add([truth("box", *REQUIRED)], [found("box", *PLACE)])
    wrong = score.figures(0.35)
    assert (wrong.pictures, wrong.exact, wrong.missed, wrong.invented) == (3, 1, {"box": 2}, {"forklift": 2})
    assert wrong.share == pytest.approx(1 / 3)


def test_the_best_detection_of_a_class_decides() -> None:
    detections = [found("box", *PLACE, score=score) for score in (0.2, 0.5, 0.1)]
    assert figures([truth("box", *REQUIRED)], *detections, confidence=0.5).exact == 1
    assert figures([truth("box", *REQUIRED)], *detections, confidence=0.51).missed == {"box": 1}


def test_no_pictures_are_no_share() -> None:
    assert ListScore().figures(0.5).share == 0
