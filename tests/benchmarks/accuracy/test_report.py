import json

from benchmarks.accuracy.following import Followed, Tally
from benchmarks.accuracy.identities import Identities
from benchmarks.accuracy.report import CONFIDENCES, report
from services.simulator.world import CLASSES
from services.training.evaluation.run import HeldOutScore
from tests.services.training.evaluation.pictures import SIZE, found, truth

FOLLOWED = Followed(
    boxes=Tally(Identities(true=10, tracked=9, matched=8, rightly=6, switches=2), detected=9),
    masks=Tally(Identities(true=10, tracked=9, matched=7, rightly=5, switches=3), detected=8),
    frames=5,
)


def score() -> HeldOutScore:
    """Return that of two pictures, one of them right."""
    made = HeldOutScore()
    for detections in ([found("box", 10, 10, 50, 50, score=0.5)], [found("pallet", 10, 10, 50, 50, score=0.4)]):
        made.masks.add(SIZE, [truth("box", 10, 10, 50, 50)], detections)
        made.lists.add([truth("box", 10, 10, 50, 50)], detections)
    return made


def test_the_figures_by_name() -> None:
    found = report(score(), FOLLOWED, 0.35)
    assert (found["mask_map50"], found["mask_map50_95"], found["truths"]) == (0.505, 0.505, 2)
    assert (found["classes_exact"], found["confidence"]) == (0.5, 0.35)
    assert found["per_class"]["box"] == {"mask_map50": 0.505, "mask_map50_95": 0.505, "truths": 2}
    assert found["per_class"].keys() == set(CLASSES)
    assert found["per_size"]["medium"]["truths"] == 2
    assert found["wrong_pictures"] == {"missed": {"box": 1}, "invented": {"pallet": 1}}
    assert found["targets"]["mask_map50"] == {"value": 0.505, "at_least": 0.9, "met": False}
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_what_was_followed_and_what_limits_it() -> None:
    found = report(score(), FOLLOWED, 0.35)
    assert (found["idf1"], found["idp"], found["idr"], found["id_switches"]) == (0.6316, 0.6667, 0.6, 2)
    assert found["following"] == {
        "asked_for": 10,
        "detected": 9,
        "tracked": 8,
        "rightly_tracked": 6,
        "wrong_tracks": 1,
        "f1_without_identities": 0.8421,
    }
    assert (found["idf1_masks"], found["idp_masks"], found["idr_masks"], found["id_switches_masks"]) == (
        *(0.5263, 0.5556, 0.5),
        3,
    )
    assert (found["following_masks"]["detected"], found["following_masks"]["wrong_tracks"]) == (8, 2)
    assert found["drive_frames"] == 5
    assert found["targets"]["idf1"] == {"value": 0.6316, "at_least": 0.85, "met": False}


def test_class_lists_at_every_confidence() -> None:
    found = {each["confidence"]: each for each in report(score(), FOLLOWED, 0.35)["by_confidence"]}
    assert tuple(found) == CONFIDENCES
    assert found[0.4]["invented"] == {"pallet": 1}
    assert found[0.45]["invented"] == {}
    assert found[0.5]["missed"] == {"box": 1}
    assert found[0.55] == {"confidence": 0.55, "classes_exact": 0.0, "missed": {"box": 2}, "invented": {}}


def test_without_objects_no_precision_is_reached() -> None:
    found = report(HeldOutScore(), Followed(Tally(), Tally(), 0), 0.35)
    assert found["mask_map50"] is None
    assert found["idf1"] is None
    assert not found["targets"]["mask_map50"]["met"]
    assert not found["targets"]["idf1"]["met"]
