"""When a picture is worth taking."""

import math

import msgspec
import pytest

from schemas.detections import ClassCount, ClassList
from services.toolbox.collect.rules import CameraRules, Rules
from tests.schemas.frames import header

NEVER = (math.inf, -math.inf)


def seen(seq: int = 0, boot_id: str = "boot", **scores: float) -> ClassList:
    about = msgspec.structs.replace(header(seq=seq), boot_id=boot_id)
    classes = [ClassCount(name, 1, score) for name, score in scores.items()]
    return ClassList(header=about, classes=classes, model="m", worker="w")


@pytest.mark.parametrize(
    ("score", "why"), [(0.24, None), (0.25, "unsure: box 0.25"), (0.4, "unsure: box 0.40"), (0.41, None)]
)
def test_a_score_between_two_is_unsure(score: float, why: str | None) -> None:
    assert CameraRules(Rules((0.25, 0.4))).seen(seen(pallet=0.9, box=score)) == why


def test_a_class_appears_that_was_not_there_before() -> None:
    rules = CameraRules(Rules(NEVER, {"forklift", "box"}))
    assert rules.seen(seen(forklift=0.9)) is None, "it may have been there all along"
    assert rules.seen(seen(forklift=0.9, pallet=0.9)) is None
    assert rules.seen(seen()) is None
    assert rules.seen(seen(forklift=0.9, box=0.8, pallet=0.9)) == "appears: box, forklift"


def test_models_disagree_about_the_same_frame_alone() -> None:
    rules = CameraRules(Rules(NEVER, disagree=True))
    assert rules.seen(seen(1, box=0.9)) is None
    assert rules.opinion(seen(2, pallet=0.9)) is None
    assert rules.seen(seen(2, box=0.9)) == "models disagree: box, pallet"
    assert rules.opinion(seen(2, "other boot")) is None
    assert rules.seen(seen(3, box=0.9)) is None
    assert rules.opinion(seen(3, box=0.3)) is None, "they see the same classes"
    for seq in range(4, 9):
        assert rules.seen(seen(seq, box=0.9)) is None
    assert rules.opinion(seen(5, pallet=0.9)) == "models disagree: box, pallet", "a slow model is some frames behind"
    unsure = CameraRules(Rules((0.25, 0.4), disagree=True))
    assert unsure.seen(seen(1, box=0.3)) == "unsure: box 0.30"
    assert unsure.opinion(seen(1, pallet=0.9)) == "models disagree: box, pallet"


def test_without_rules_nothing_is_asked_for() -> None:
    rules = CameraRules(Rules(NEVER))
    assert rules.seen(seen(box=0.3)) is None
    assert rules.opinion(seen(pallet=0.3)) is None
