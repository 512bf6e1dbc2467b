from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Box, Detection
from services.training.evaluation.photographs import PhotographScore, matches, score_photographs
from services.training.files import TrainingError
from services.training.photographs import LabelledObject, Photograph

BOX, PALLET, FORKLIFT = range(3)
NONE = frozenset[int]()
EVERY = frozenset({BOX, PALLET, FORKLIFT})


def labelled(class_index: int, left: float, top: float, right: float, bottom: float) -> LabelledObject:
    corners = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    return LabelledObject(class_index, corners)


def found(name: str, *corners: float, score: float = 0.9) -> Detection:
    return Detection(name=name, score=score, box=Box(*corners))


def picture(*objects: LabelledObject, labelled: frozenset[int] = EVERY, absent: frozenset[int] = NONE) -> Photograph:
    return Photograph(Path("a.jpg"), "yard", objects, absent, EVERY - labelled - absent)


def scored(photograph: Photograph, *detections: Detection) -> PhotographScore:
    score = PhotographScore()
    score.add(photograph, detections, 100, 200)
    return score


def test_each_label_is_found_once() -> None:
    label = np.array((0.0, 0.0, 10.0, 10.0))
    assert matches([label], [label, label]) == 1
    assert matches([label, label + 20], [label + 20, label]) == 2


def test_recall_and_precision_are_of_classes_that_are_labelled() -> None:
    photograph = picture(labelled(BOX, 0, 0, 0.5, 0.5), labelled(BOX, 0.6, 0.6, 1, 1), labelled=frozenset({BOX}))
    score = scored(photograph, found("box", 0, 0, 50, 100), found("box", 0, 0, 5, 5), found("pallet", 0, 0, 50, 100))
    summary = score.summary()
    assert summary["recall"] == {"box": 0.5}
    assert summary["precision"] == {"box": 0.5}
    assert summary["empty_pictures"] == 0


def test_a_prediction_of_another_class_finds_nothing() -> None:
    score = scored(picture(labelled(FORKLIFT, 0, 0, 1, 1)), found("box", 0, 0, 100, 200))
    assert score.classes["forklift"].found == 0
    assert score.classes["box"].wrong == 1


def test_false_alarms_are_those_where_no_class_is() -> None:
    score = scored(picture(labelled=NONE, absent=EVERY), found("box", 0, 0, 9, 9), found("forklift", 0, 0, 9, 9))
    assert score.false_alarms_per_picture == 2
    assert score.summary()["false_alarms"] == {"box": 1, "forklift": 1}


def test_a_picture_of_which_something_is_unknown_has_no_false_alarms() -> None:
    score = scored(picture(labelled=NONE, absent=frozenset({BOX})), found("pallet", 0, 0, 9, 9))
    assert score.false_alarms_per_picture is None


def test_pictures_are_shown_as_rgb_and_counted_by_source(tmp_path: Path) -> None:
    red = np.zeros((20, 10, 3), np.uint8)
    red[..., 2] = 255
    cv2.imwrite(str(tmp_path / "a.png"), red)
    seen: list[NDArray[np.uint8]] = []

    def predict(image: NDArray[np.uint8]) -> Sequence[Detection]:
        seen.append(image)
        return [found("pallet", 0, 0, 10, 20)]

    photograph = Photograph(tmp_path / "a.png", "yard", (labelled(PALLET, 0, 0, 1, 1),))
    scores = score_photographs([photograph], predict, lambda _: None)
    assert seen[0][0, 0].tolist() == [255, 0, 0]
    assert {source: score.classes["pallet"].recall for source, score in scores.items()} == {"all": 1.0, "yard": 1.0}


def test_a_damaged_picture_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"no picture")
    with pytest.raises(TrainingError, match=r"a\.jpg: not a picture"):
        score_photographs([Photograph(tmp_path / "a.jpg", "yard", ())], lambda _: [], lambda _: None)
