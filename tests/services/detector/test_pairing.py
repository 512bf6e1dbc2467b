import pytest

from schemas.detections import Box, Detection, Mask
from schemas.tuning import Tuning
from services.detector.account import FAILED
from services.detector.model import SILENT, Failed, Found, Request, TuningError
from services.detector.pairing import PairedModel, joined
from tests.services.detector.fakes import FakeModel
from tests.services.detector.test_worker import FRONT, frame

MASK = Mask((4, 6), "abc")
PLACE, BESIDE = Box(0, 0, 10, 10), Box(0, 0, 10, 4)


def box(name: str, place: Box, mask: Mask | None = None) -> Detection:
    return Detection(name=name, score=0.8, box=place, mask=mask)


def test_a_mask_goes_to_the_object_of_its_name_in_its_place_once() -> None:
    boxes = Found([box("box", PLACE), box("box", PLACE), box("pallet", PLACE)], {"model": 3})
    seen = joined(boxes, Found([box("box", PLACE, MASK), box("pallet", BESIDE, MASK)], {"model": 4}))
    assert isinstance(seen, Found)
    assert [each.mask for each in seen.objects] == [MASK, None, None]
    assert seen.spans == {"model": 7}


def test_without_masks_there_are_boxes_and_without_boxes_nothing() -> None:
    found, failed = Found([box("box", PLACE)]), Failed(FAILED, RuntimeError("unlucky"))
    assert joined(found, failed) is found
    assert joined(failed, found) is failed


async def test_the_second_model_is_asked_only_where_masks_are_wanted() -> None:
    boxes, masks = FakeModel(segments=False, remarks=(f"fake has no masks: {SILENT}", "slow")), FakeModel()
    model = PairedModel(boxes, masks)
    with_mask, without = await model.infer(
        [Request(FRONT, frame(0), masks=True), Request(FRONT, frame(1), masks=False)]
    )
    assert isinstance(with_mask, Found)
    assert isinstance(without, Found)
    assert with_mask.objects[0].mask is not None
    assert without.objects[0].mask is None
    assert (len(boxes.seen), len(masks.seen)) == (2, 1)
    assert (model.segments, model.remarks, model.name) == (True, ("slow",), "fake+fake")


def test_settings_hold_for_both_or_for_none() -> None:
    boxes, masks = FakeModel(), FakeModel()
    model = PairedModel(boxes, masks)
    model.tune(Tuning(confidence=0.9))
    assert boxes.tuning.confidence == masks.tuning.confidence == 0.9
    with pytest.raises(TuningError):
        model.tune(Tuning(classes=["unicorn"]))
    assert boxes.tuning == masks.tuning == model.tuning
