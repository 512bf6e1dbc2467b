from schemas.tuning import Tuning
from services.detector.runtime.criteria import Criteria


def test_a_class_that_is_named_twice_is_reported_once() -> None:
    names = {0: "box", 1: "pallet"}
    assert Criteria().tuned(Tuning(classes=["pallet", "box", "pallet"]), names).tuning.classes == ["pallet", "box"]
