from typing import Any

import msgspec
import pytest

from schemas.detections import Detection
from services.simulator.world import CLASSES
from services.training.evaluation.precision import MaskFigures, MaskScore, Precision
from services.training.evaluation.truths import Truth
from tests.services.training.evaluation.pictures import SIZE, found, truth

BOX = (10, 10, 50, 50)
OTHER = (100, 10, 140, 50)
RIGHT: Any = pytest.approx(1)


def figures(*pictures: tuple[list[Truth], list[Detection]]) -> MaskFigures:
    score = MaskScore()
    for truths, detections in pictures:
        score.add(SIZE, truths, detections)
    return score.figures()


def map50(truths: list[Truth], *detections: Detection) -> float | None:
    return figures((truths, list(detections))).overall.map50


def test_what_is_found_exactly_is_right_at_every_overlap() -> None:
    found_all = figures(([truth("box", *BOX)], [found("box", *BOX)]))
    assert found_all.overall == Precision(RIGHT, RIGHT, 1)


def test_what_is_missed_halves_the_recall() -> None:
    missed = map50([truth("box", *BOX), truth("box", *OTHER)], found("box", *BOX))
    assert missed == pytest.approx(0.5, abs=0.01)


def test_what_is_found_first_where_nothing_is_halves_the_precision() -> None:
    detections = [found("box", *OTHER, score=0.95), found("box", *BOX)]
    assert map50([truth("box", *BOX)], *detections) == pytest.approx(0.5)
    assert map50([truth("box", *BOX)], *reversed(detections)) == pytest.approx(0.5)


def test_half_an_overlap_is_enough_for_the_first_figure_alone() -> None:
    half = figures(([truth("box", *BOX)], [found("box", 10, 10, 50, 30)])).overall
    assert half.map50 == RIGHT
    assert half.map50_95 == pytest.approx(0.1)
    assert map50([truth("box", *BOX)], found("box", 10, 10, 50, 29)) == 0


@pytest.mark.parametrize(
    "ignored", [truth("box", *OTHER, visibility=0.49), truth("box", 100, 10, 101, 29)], ids=["hidden", "tiny"]
)
def test_an_object_that_is_not_asked_for_may_be_found_or_not(ignored: Truth) -> None:
    truths = [truth("box", *BOX), ignored]
    on_it = Detection(name="box", score=0.99, box=found("box", *OTHER).box, mask=ignored.mask)
    for detections in ([found("box", *BOX)], [on_it, found("box", *BOX)], [on_it, on_it, found("box", *BOX)]):
        assert figures((truths, detections)).overall == Precision(RIGHT, RIGHT, 1)


def test_objects_just_large_and_visible_enough_are_asked_for() -> None:
    assert map50([truth("box", 0, 0, 20, 1, visibility=0.5)]) == 0
    assert map50([truth("box", 0, 0, 19, 1, visibility=0.5)]) is None
    assert map50([truth("box", 0, 0, 20, 1, visibility=0.499)]) is None


def test_part_of_a_hidden_object_is_not_wrong() -> None:
    truths = [truth("box", *BOX), truth("box", *OTHER, visibility=0.3)]
    assert map50(truths, found("box", 110, 10, 120, 20, score=0.99), found("box", *BOX)) == RIGHT


def test_another_class_on_a_hidden_object_is_wrong() -> None:
    truths = [truth("pallet", *BOX), truth("box", *OTHER, visibility=0.3)]
    assert map50(truths, found("pallet", *OTHER, score=0.99), found("pallet", *BOX)) == pytest.approx(0.5)


def test_a_second_detection_of_the_same_object_is_wrong() -> None:
    detections = [found("box", *BOX), found("box", *BOX, score=0.8), found("box", *OTHER, score=0.7)]
    assert map50([truth("box", *BOX), truth("box", *OTHER)], *detections) == pytest.approx(0.835, abs=0.005)


def test_classes_count_alike_and_those_without_objects_not_at_all() -> None:
    truths = [truth("box", *BOX), truth("box", *OTHER), truth("pallet", 60, 60, 90, 90)]
    by_class = figures((truths, [found("box", *BOX), found("box", *OTHER)]))
    assert by_class.overall.map50 == pytest.approx(0.5)
    assert {name: each.map50 for name, each in by_class.per_class.items()} == {
        "box": RIGHT,
        "pallet": 0,
        "forklift": None,
    }
    assert {name: each.truths for name, each in by_class.per_class.items()} == {"box": 2, "pallet": 1, "forklift": 0}


def test_a_size_band_asks_for_its_own_objects() -> None:
    small, large = (10, 10, 30, 30), (90, 0, 200, 100)
    found_small = figures(([truth("box", *small), truth("box", *large)], [found("box", *small)])).per_size
    assert {name: (each.map50, each.truths) for name, each in found_small.items()} == {
        "small": (RIGHT, 1),
        "medium": (None, 0),
        "large": (0, 1),
    }


def test_pictures_are_kept_apart() -> None:
    assert figures(([truth("box", *BOX)], []), ([], [found("box", *BOX)])).overall.map50 == 0


def test_without_any_detection_or_any_object() -> None:
    assert map50([truth("box", *BOX)]) == 0
    assert map50([], found("box", *BOX)) is None
    assert figures(([], [])).per_class.keys() == set(CLASSES)


def test_nothing_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert map50([truth("box", *BOX)], found("box", *BOX)) == RIGHT
    assert capsys.readouterr() == ("", "")


def test_masks_of_better_quality_come_first_among_equal_scores() -> None:
    truths = [truth("box", *BOX)]
    wrong, right = (found("box", *place, score=0.8) for place in (OTHER, BOX))

    def judged(*qualities: float) -> list[Detection]:
        return [
            msgspec.structs.replace(each, mask=msgspec.structs.replace(each.mask, quality=quality))  # type: ignore[type-var]
            for each, quality in zip((wrong, right), qualities, strict=True)
        ]

    assert map50(truths, *judged(0.2, 0.9)) == RIGHT
    assert map50(truths, *judged(0.9, 0.2)) == pytest.approx(0.5)


def test_masks_in_the_order_of_scores_alone_are_told_too() -> None:
    wrong, right = found("box", *OTHER, score=0.9), found("box", *BOX, score=0.8)
    doubted = msgspec.structs.replace(wrong, mask=msgspec.structs.replace(wrong.mask, quality=0.1))  # type: ignore[type-var]
    told = figures(([truth("box", *BOX)], [doubted, right]))
    assert told.overall.map50 == RIGHT
    assert told.by_score.map50 == pytest.approx(0.5)


def test_what_cannot_be_scored_is_refused() -> None:
    with pytest.raises(ValueError, match="a box without a mask"):
        map50([], msgspec.structs.replace(found("box", *BOX), mask=None))
    with pytest.raises(KeyError, match="person"):
        map50([], found("person", *BOX))
