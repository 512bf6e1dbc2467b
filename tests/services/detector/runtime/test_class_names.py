"""Classes of a model that are renamed and merged, and scores that single classes need."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from schemas.detections import Detection
from schemas.tuning import Tuning
from services.detector.model import ModelError, TuningError
from services.detector.runtime.criteria import Criteria, merged, renamed
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.loading import load
from services.detector.runtime.model_file import Head
from services.detector.runtime.postprocess import Output, objects
from services.detector.settings import DetectorSettings
from tests.services.detector.runtime.engines import FACTS, STRIDE, output

SQUARE = Letterbox.fit(64, 64, 64, STRIDE)
ONE = renamed(FACTS.names, {"pallet": "box"})
HALF = [(32.0, 32.0, 32.0, 32.0), (34.0, 32.0, 32.0, 32.0)]


def found(
    of: Output,
    names: Mapping[int, str] = FACTS.names,
    *,
    head: Head = "nms",
    tuning: Tuning | None = None,
    **more: float,
) -> list[tuple[str, int, float]]:
    criteria = Criteria(confidence=0.3, class_confidence=more).tuned(tuning or Tuning(), names)
    seen: list[Detection] = objects(of, SQUARE, criteria, names, masks=False, head=head)
    return [(each.name, each.label, round(each.score, 2)) for each in seen]


def test_names_change_and_the_rest_stay() -> None:
    assert renamed({0: "a", 1: "b"}, {"b": "c"}) == {0: "a", 1: "c"}
    assert merged({0: "a", 1: "b"}) is None
    labels = merged({0: "a", 1: "b", 2: "a"})
    assert labels is not None
    assert labels.tolist() == [0, 1, 0]


def test_classes_that_get_one_name_are_one_class() -> None:
    twice = output(HALF, [(0.9, 0), (0, 0.8)])
    assert found(twice) == [("box", 0, 0.9), ("pallet", 1, 0.8)]
    assert found(twice, ONE) == [("box", 0, 0.9)], "of overlapping boxes of one class the best counts"
    assert found(output(HALF[1:], [(0, 0.8)]), ONE) == [("box", 0, 0.8)]


def test_an_nms_free_head_that_finds_an_object_as_both_of_them_finds_it_once() -> None:
    both = output([HALF[0], (8, 8, 4, 4)], [(0.9, 0.8), (0, 0)])
    assert found(both, head="nms-free") == [("box", 0, 0.9), ("pallet", 1, 0.8)]
    assert found(both, ONE, head="nms-free") == [("box", 0, 0.9)]


def test_a_class_may_need_another_score_than_the_rest() -> None:
    two = output([(10, 10, 8, 4), (40, 40, 10, 10)], [(0.4, 0), (0, 0.2)])
    assert found(two) == [("box", 0, 0.4)]
    assert found(two, box=0.5, pallet=0.1) == [("pallet", 1, 0.2)]
    stricter = Tuning(confidence=0.9)
    assert found(two, tuning=stricter, pallet=0.1) == [("pallet", 1, 0.2)], "a request changes what the rest need"


def test_a_score_for_a_class_that_there_is_not_is_refused() -> None:
    with pytest.raises(TuningError, match="no class is called 'unicorn'; the model knows box, pallet"):
        Criteria(class_confidence={"unicorn": 0.5}).tuned(Tuning(), FACTS.names)


def test_the_shipped_model_reports_the_new_names(tmp_path: Path) -> None:
    settings = DetectorSettings(
        runtime="torch", class_names=["pallet=load", "box=load"], class_confidence=["load=0.4"], classes=["load"]
    )
    model = load(settings, tmp_path)
    assert (model.classes, model.facts.names) == (("load",), {0: "load", 1: "load", 2: "forklift"})
    model.close()


@pytest.mark.parametrize(("option", "given"), [("class_names", ["unicorn=box"]), ("class_confidence", ["unicorn=0.5"])])
def test_classes_that_the_model_does_not_know_are_refused(option: str, given: list[str], tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=f"^--{option.replace('_', '-')} with --model .*no class is called 'unicorn'"):
        load(DetectorSettings.model_validate({"runtime": "torch", option: given}), tmp_path)


@pytest.mark.parametrize(
    ("option", "given", "why"),
    [
        ("class_names", ["box"], "box: write a class's name and its new name, such as parcel=box"),
        ("class_names", ["box= "], "write a class's name and its new name"),
        ("class_names", ["box=" + "x" * 500], "a name may have"),
        ("class_names", ["box=a", "box=b"], "box is given 2 times"),
        ("class_confidence", ["box"], "box: write a class's name and a score from 0 to 1, such as forklift=0.5"),
        ("class_confidence", ["box=1.5"], "a score from 0 to 1"),
        ("class_confidence", ["box=nan"], "a score from 0 to 1"),
        ("class_confidence", ["box=0.5", "box=0.6"], "box is given 2 times"),
    ],
)
def test_what_cannot_be_meant_is_refused_by_the_settings(option: str, given: list[str], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        DetectorSettings.model_validate({option: given})
