import pytest

from schemas.detections import Box, Detection, Mask
from schemas.tuning import Tuning
from services.detector.model import (
    NO_MASKS,
    NO_MASKS_OF_POSES,
    DetectedObjects,
    Failed,
    ModelError,
    Request,
    TuningError,
)
from services.detector.pairing import PairedModel, joined
from tests.services.detector.support.fakes import FakeModel
from tests.services.detector.support.told_model import ToldModel
from tests.services.detector.test_worker import FRONT, frame

MASK, OTHER = Mask((4, 6), "abc"), Mask((4, 6), "abd")
PLACE, BESIDE = Box(0, 0, 10, 10), Box(0, 0, 10, 4)


def box(name: str, place: Box, mask: Mask | None = None) -> Detection:
    return Detection(name=name, score=0.8, box=place, mask=mask)


def test_a_mask_goes_to_the_object_of_its_name_in_its_place_once() -> None:
    boxes = DetectedObjects([box("box", PLACE), box("box", PLACE), box("pallet", PLACE)], {"model": 3})
    seen = joined(boxes, DetectedObjects([box("box", PLACE, MASK), box("pallet", BESIDE, MASK)], {"model": 4}))
    assert [each.mask for each in seen.objects] == [MASK, None, None]
    assert seen.spans == {"model": 7}


def test_a_surer_object_has_the_better_fitting_mask_and_the_next_what_is_left() -> None:
    masks = [box("box", Box(0, 0, 10, 8), MASK), box("box", PLACE, OTHER)]
    seen = joined(DetectedObjects([box("box", PLACE), box("box", PLACE)]), DetectedObjects(masks))
    assert [each.mask for each in seen.objects] == [OTHER, MASK]


@pytest.mark.parametrize(("bottom", "mask"), [(5.0, MASK), (4.9, None)])
def test_half_of_both_boxes_must_be_in_common(bottom: float, mask: Mask | None) -> None:
    seen = joined(DetectedObjects([box("box", PLACE)]), DetectedObjects([box("box", Box(0, 0, 10, bottom), MASK)]))
    assert seen.objects[0].mask == mask


def test_nothing_has_no_masks_and_no_masks_leave_everything_as_it_is() -> None:
    some = [box("box", PLACE)]
    assert joined(DetectedObjects(some), DetectedObjects([])).objects == some
    assert joined(DetectedObjects([]), DetectedObjects(some)).objects == []


async def test_without_masks_there_are_boxes_and_it_is_said_and_without_boxes_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    request = Request(FRONT, frame(7, color=FakeModel.FATAL), masks=True)
    (found,) = await PairedModel(ToldModel(at_once=True), FakeModel()).infer([request])
    assert isinstance(found, DetectedObjects)
    assert "r1/front: frame 7 has no masks, failed in the model: RuntimeError('this image is fatal')" in caplog.text
    (failed,) = await PairedModel(FakeModel(), ToldModel(at_once=True)).infer([request])
    assert isinstance(failed, Failed)


@pytest.mark.parametrize("which", [0, 1])
async def test_what_ends_one_model_is_the_error_that_callers_of_any_model_know(which: int) -> None:
    models = [FakeModel(), FakeModel()]
    models[which].broken = True
    with pytest.raises(ModelError, match="no memory"):
        await PairedModel(*models).infer([Request(FRONT, frame(0), masks=True)])


async def test_the_second_model_is_asked_only_where_masks_are_wanted() -> None:
    boxes, masks = (
        FakeModel(segments=False, remarks=(f"fake has no masks: {NO_MASKS}", f"a {NO_MASKS_OF_POSES}", "slow")),
        FakeModel(),
    )
    model = PairedModel(boxes, masks)
    with_mask, without = await model.infer(
        [Request(FRONT, frame(0), masks=True), Request(FRONT, frame(1), masks=False)]
    )
    assert isinstance(with_mask, DetectedObjects)
    assert isinstance(without, DetectedObjects)
    assert with_mask.objects[0].mask is not None
    assert without.objects[0].mask is None
    assert (len(boxes.seen), len(masks.seen)) == (2, 1)
    assert (model.segments, model.remarks, model.name) == (True, ("slow",), "fake+fake")
    assert model.runtime == "fake"
    boxes.runtime = "torch"
    assert model.runtime == "torch+fake"


def test_settings_hold_for_both_or_for_none() -> None:
    boxes, masks = FakeModel(), FakeModel()
    model = PairedModel(boxes, masks)
    model.tune(Tuning(confidence=0.9))
    assert boxes.tuning.confidence == masks.tuning.confidence == 0.9
    with pytest.raises(TuningError):
        model.tune(Tuning(classes=["unicorn"]))
    assert boxes.tuning == masks.tuning == model.tuning
