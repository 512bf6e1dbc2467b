from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pycocotools import mask as coco

from schemas.detections import Detection
from services.detector.runtime.candidates import Candidates
from services.detector.runtime.criteria import Criteria
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.postprocess import Output, OutputError, objects
from services.detector.runtime.refinement.refiner import BOX, SIDE, CloseUps, Refined
from tests.services.detector.runtime.engines import FACTS, STRIDE, output

CRITERIA = Criteria(confidence=0.3, iou=0.5)
SQUARE = Letterbox.fit(64, 64, 64, STRIDE)


def found(of: Output, letterbox: Letterbox = SQUARE, criteria: Criteria = CRITERIA) -> list[Detection]:
    return objects(of, letterbox, criteria, FACTS.names, masks=True)


def corners(of: Detection) -> tuple[float, ...]:
    return of.box.x1, of.box.y1, of.box.x2, of.box.y2


def pixels(of: Detection) -> NDArray[np.uint8]:
    assert of.mask is not None
    return np.asarray(coco.decode({"size": list(of.mask.size), "counts": of.mask.counts.encode()}), np.uint8)


def test_boxes_of_the_best_class_best_first() -> None:
    seen = found(output([(10, 10, 8, 4), (40, 40, 10, 10)], [(0.4, 0.2), (0.1, 0.9)]))
    assert [(each.name, each.label, round(each.score, 3), corners(each)) for each in seen] == [
        ("pallet", 1, 0.9, (35, 35, 45, 45)),
        ("box", 0, 0.4, (6, 8, 14, 12)),
    ]


@pytest.mark.parametrize("place", range(4))
def test_a_box_that_is_nowhere_is_no_output_of_such_a_model(place: int) -> None:
    box = [10.0, 10.0, 8.0, 4.0]
    box[place] = np.nan
    with pytest.raises(OutputError, match="not a number"):
        found(output([(box[0], box[1], box[2], box[3])], [(0.9, 0)]))


@pytest.mark.parametrize("scores", [(np.nan, 0), (0, np.nan), (np.nan, np.nan)])
def test_a_score_that_is_not_a_number_is_not_an_empty_view(scores: tuple[float, float]) -> None:
    with pytest.raises(OutputError, match="a score that is not a number"):
        found(output([(10, 10, 8, 4), (40, 40, 10, 10)], [scores, (0.9, 0)]))
    with pytest.raises(OutputError, match="a score that is not a number"):
        found(Output(np.array([[6, 8, 14, 12, sum(scores), 0]], np.float32), None))


def test_a_mask_that_is_not_a_number_is_not_an_empty_mask() -> None:
    with pytest.raises(OutputError, match="a mask that is not a number"):
        found(output([(10, 10, 8, 4)], [(0.9, 0)], np.ones((1, 16, 16), np.float32), [[np.nan]]))


def test_the_confidence_itself_is_not_enough() -> None:
    assert not found(output([(10, 10, 8, 4)], [(0.5, 0)]), criteria=Criteria(confidence=0.5))


def test_an_overlap_of_iou_counts_twice_a_larger_one_once_and_classes_do_not_mix() -> None:
    half = [(16, 16, 16, 16), (16, 12, 16, 8)]
    assert len(found(output(half, [(0.9, 0), (0.8, 0)]))) == 2
    assert len(found(output(half, [(0.9, 0), (0.8, 0)]), criteria=Criteria(confidence=0.3, iou=0.49))) == 1
    assert len(found(output(half, [(0.9, 0), (0, 0.8)]), criteria=Criteria(confidence=0.3, iou=0))) == 2


def test_no_more_than_asked_for() -> None:
    many = output([(4 + 8 * n, 4, 4, 4) for n in range(8)], [(0.3 + 0.05 * n, 0) for n in range(8)])
    seen = found(many, criteria=Criteria(confidence=0.2, max_detections=3))
    assert [round(each.score, 2) for each in seen] == [0.65, 0.6, 0.55]


def test_places_are_those_in_the_image_and_none_is_outside() -> None:
    letterbox = Letterbox.fit(480, 640, 320, STRIDE)
    (seen,) = found(output([(300, 20, 80, 40)], [(0.9, 0)]), letterbox)
    assert corners(seen) == (520, 0, 640, 64)


def test_a_mask_is_interpolated_where_its_box_is_and_nowhere_else() -> None:
    prototypes = np.full((1, 16, 16), -1, np.float32)
    prototypes[0, :, 4:8] = 1
    (seen,) = found(output([(24, 24, 20, 20)], [(0.9, 0)], prototypes, [[1.0]]))
    expected = np.zeros((64, 64), np.uint8)
    expected[14:34, 16:32] = 1
    assert np.array_equal(pixels(seen), expected)
    assert seen.mask is not None
    assert seen.mask.size == (64, 64)


@pytest.mark.parametrize("masks", [False, True])
def test_an_object_without_a_pixel_of_a_mask_is_none(*, masks: bool) -> None:
    prototypes = np.full((1, 16, 16), -1, np.float32)
    prototypes[0, :, 4:8] = 1
    boxes = [(50.0, 50.0, 8.0, 8.0), (24.0, 24.0, 20.0, 20.0), (24.4, 24.0, 0.2, 8.0)]
    of = output(boxes, [(0.9, 0), (0.8, 0), (0.7, 0)], prototypes, [[1.0]] * 3)
    seen = objects(of, SQUARE, CRITERIA, FACTS.names, masks=masks)
    assert [round(each.score, 1) for each in seen] == [0.8]


@pytest.mark.parametrize("masks", [False, True])
def test_prototypes_that_are_no_numbers_are_no_empty_view(*, masks: bool) -> None:
    of = output([(20, 36, 8, 8)], [(0.9, 0)], np.full((1, 16, 16), np.nan, np.float32), [[1]])
    with pytest.raises(OutputError, match="prototypes of masks that are not numbers"):
        objects(of, SQUARE, CRITERIA, FACTS.names, masks=masks)


def test_boxes_of_other_classes_are_suppressed_too_where_that_is_asked_for() -> None:
    of = output([(16, 16, 16, 16), (16, 16, 16, 14)], [(0.8, 0), (0, 0.9)])
    assert [each.name for each in found(of)] == ["pallet", "box"]
    assert [each.name for each in found(of, criteria=Criteria(agnostic=True))] == ["pallet"]


def test_an_nms_free_head_has_every_class_of_a_place_and_suppresses_nothing() -> None:
    of = output([(16, 16, 16, 16), (16, 16, 16, 14)], [(0.8, 0.4), (0.35, 0.9)])

    def seen(**criteria: Any) -> list[tuple[str, float]]:
        chosen = Criteria(confidence=0.3, **criteria)
        return [
            (each.name, round(each.score, 2))
            for each in objects(of, SQUARE, chosen, FACTS.names, masks=False, head="nms-free")
        ]

    assert seen() == [("pallet", 0.9), ("box", 0.8)]  # no more than there are places, as Ultralytics'
    assert seen(agnostic=True) == [("pallet", 0.9), ("box", 0.8)]
    assert seen(max_detections=1) == [("pallet", 0.9)]


def test_boxes_of_rt_detr_are_shares_of_a_stretched_image() -> None:
    letterbox = Letterbox.fit(100, 200, 64, STRIDE, stretched=True)
    assert letterbox.shape == (64, 64)
    rows = np.array([[0.5, 0.5, 0.2, 0.4, 0.9, 1], [0.1, 0.2, 0.4, 0.2, 0.8, 0]], np.float32)
    first, second = objects(Output(rows, None), letterbox, CRITERIA, FACTS.names, masks=False, head="rt-detr")
    assert corners(first) == pytest.approx((80, 30, 120, 70))
    assert corners(second) == pytest.approx((0, 10, 60, 30))
    with pytest.raises(OutputError):
        objects(output([(16, 16, 8, 8)], [(0.9, 0)]), letterbox, CRITERIA, FACTS.names, masks=False, head="rt-detr")


def striped() -> NDArray[np.float32]:
    """Return four prototypes: left of columns 8, 12, 13 of 16, and all of it."""
    prototypes = np.full((4, 16, 16), -1, np.float32)
    for n, end in enumerate((8, 12, 13, 16)):
        prototypes[n, :, :end] = 1
    return prototypes


@pytest.mark.parametrize(("stripe", "both"), [(3, True), (1, False)])
def test_a_mask_that_surer_ones_of_its_class_mostly_cover_is_none_of_its_own(stripe: int, *, both: bool) -> None:
    boxes = [(32.0, 32.0, 64.0, 64.0), (32.0, 32.0, 64.0, 62.0)]
    coefficients = [[1.0, 0, 0, 0], np.eye(4)[stripe].tolist()]
    loose = Criteria(confidence=0.3, iou=1)
    assert len(found(output(boxes, [(0.9, 0), (0.8, 0)], striped(), coefficients), criteria=loose)) == 1 + both
    assert len(found(output(boxes, [(0.9, 0), (0, 0.8)], striped(), coefficients), criteria=loose)) == 2


def test_a_mask_is_covered_by_several_together_and_not_by_what_is_left_out_itself() -> None:
    whole = (32.0, 32.0, 64.0, 64.0)
    boxes = [(8.0, 32.0, 16.0, 64.0), (32.0, 32.0, 64.0, 62.0), (56.0, 32.0, 16.0, 64.0)]
    ones = np.ones((1, 16, 16), np.float32)
    loose = Criteria(confidence=0.3, iou=1)
    beside = found(output([*boxes[::2], boxes[1]], [(0.9, 0), (0.8, 0), (0.7, 0)], ones, [[1.0]] * 3), criteria=loose)
    assert [round(each.score, 1) for each in beside] == [0.9, 0.8, 0.7]  # half of the last one shows
    half = (24.0, 32.0, 48.0, 64.0)
    rest = found(output([half, whole, boxes[2]], [(0.9, 0), (0.8, 0), (0.7, 0)], ones, [[1.0]] * 3), criteria=loose)
    assert [round(each.score, 1) for each in rest] == [0.9, 0.7]


def test_objects_are_the_same_whether_masks_are_wanted_or_not() -> None:
    twins = output([(32, 32, 64, 64)] * 2, [(0.9, 0), (0.8, 0)], np.ones((1, 16, 16), np.float32), [[1.0]] * 2)
    assert len(objects(twins, SQUARE, Criteria(confidence=0.3, iou=1), FACTS.names, masks=False)) == 1


def test_the_padding_of_a_letterbox_has_no_say() -> None:
    letterbox = Letterbox.fit(48, 64, 64, STRIDE)
    assert letterbox.shape == (64, 64)
    prototypes = np.full((1, 16, 16), -1, np.float32)
    prototypes[0, 2:14] = 1
    (seen,) = found(output([(32, 32, 64, 64)], [(0.9, 0)], prototypes, [[1.0]]), letterbox)
    assert pixels(seen).all()


def test_a_model_that_suppresses_doubles_itself() -> None:
    rows = np.array([[6, 8, 14, 12, 0.4, 0, 1], [35, 35, 45, 45, 0.9, 1, 1], [0, 0, 1, 1, 0.1, 0, 1]], np.float32)
    seen = found(Output(rows, np.ones((1, 16, 16), np.float32)))
    assert [(each.name, corners(each)) for each in seen] == [("pallet", (35, 35, 45, 45)), ("box", (6, 8, 14, 12))]
    assert pixels(seen[0]).sum() == 100


@pytest.mark.parametrize("predictions", [np.zeros((9, 5), np.float32), np.array([[1, 1, 2, 2, 0.9, 7]], np.float32)])
def test_another_models_output_is_refused(predictions: NDArray[np.float32]) -> None:
    with pytest.raises(OutputError):
        found(Output(predictions, None))


@pytest.mark.parametrize(("height", "width"), [(64, 64), (128, 128), (96, 128), (60, 64)])
def test_refined_masks_lie_where_their_close_ups_are(height: int, width: int) -> None:
    letterbox = Letterbox.fit(height, width, 64, STRIDE)
    of = output([(20, 36, 8, 8)], [(0.9, 0)], np.ones((1, 16, 16), np.float32), [[1]])

    def refine(candidates: Candidates, prototypes: NDArray[np.float32]) -> tuple[CloseUps, Refined]:
        assert candidates.corners.tolist() == [[16, 32, 24, 40]]
        assert prototypes.shape == (1, 16, 16)
        odds = np.full((1, SIDE, SIDE), -1, np.float32)
        odds[0, : SIDE // 2] = 1  # the upper half
        return looks((12, 28, 28, 44)), judged(odds)

    (seen,) = objects(of, letterbox, CRITERIA, FACTS.names, masks=True, refine=refine)
    expected = np.zeros((height, width), np.uint8)
    scale = width / 64
    top = (64 - height / scale) / 2 // 1  # the padding above
    expected[round((28 - top) * scale) : round((36 - top) * scale), round(12 * scale) : round(28 * scale)] = 1
    assert np.array_equal(pixels(seen), expected)
    rows, columns = np.nonzero(expected)
    assert corners(seen) == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)


def test_a_refined_mask_says_how_good_it_is_and_another_does_not() -> None:
    of = output([(20, 36, 8, 8)], [(0.9, 0)], np.ones((1, 16, 16), np.float32), [[1]])
    odds = np.ones((1, SIDE, SIDE), np.float32)
    for quality in (0.0, 0.75, 1.0):
        refined = looks((12, 28, 28, 44)), judged(odds, quality)
        (seen,) = objects(of, SQUARE, CRITERIA, FACTS.names, masks=True, refine=lambda *_, to=refined: to)
        assert seen.mask is not None
        assert seen.mask.quality == quality
        assert seen.score == pytest.approx(0.9)
    (coarse,) = objects(of, SQUARE, CRITERIA, FACTS.names, masks=True)
    assert coarse.mask is not None
    assert coarse.mask.quality is None


def test_what_cannot_be_refined_keeps_the_mask_and_the_box_that_the_model_gave_it() -> None:
    of = output([(20, 36, 8, 8)], [(0.9, 0)], np.ones((1, 16, 16), np.float32), [[1]])
    refined_not = objects(of, SQUARE, CRITERIA, FACTS.names, masks=True, refine=lambda *_: None)
    assert refined_not == objects(of, SQUARE, CRITERIA, FACTS.names, masks=True)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_masks_of_prototypes_that_are_no_numbers_are_refused(value: float) -> None:
    of = output([(20, 36, 8, 8)], [(0.9, 0)], np.full((1, 16, 16), value, np.float32), [[1]])
    with pytest.raises(OutputError, match="prototypes of masks that are not numbers"):
        objects(of, SQUARE, CRITERIA, FACTS.names, masks=True)


def test_what_lies_apart_from_an_objects_box_is_none_of_it() -> None:
    of = output([(20, 36, 8, 8)], [(0.9, 0)], np.ones((1, 16, 16), np.float32), [[1]])
    seen, odds = looks((12, 28, 28, 44)), np.full((1, SIDE, SIDE), -1, np.float32)
    seen.pixels[..., BOX] = 0
    seen.pixels[0, 16:48, 16:48, BOX] = 255
    odds[0, 16:48, 16:48] = odds[0, :8, 60:] = 1
    (found,) = objects(of, SQUARE, CRITERIA, FACTS.names, masks=True, refine=lambda *_: (seen, judged(odds)))
    assert corners(found) == (16, 32, 24, 40)
    assert pixels(found).sum() == 64


def test_an_object_of_whose_mask_nothing_is_left_keeps_its_box() -> None:
    of = output([(20, 36, 8, 8)], [(0.9, 0)], np.ones((1, 16, 16), np.float32), [[1]])
    nothing = looks((12, 28, 28, 44)), judged(np.full((1, SIDE, SIDE), -1, np.float32))
    (seen,) = objects(of, SQUARE, CRITERIA, FACTS.names, masks=True, refine=lambda *_: nothing)
    assert not pixels(seen).any()
    assert corners(seen) == (16, 32, 24, 40)


def test_nothing_is_refined_for_nobody() -> None:
    of = output([(20, 36, 8, 8)], [(0.9, 0)], np.ones((1, 16, 16), np.float32), [[1]])

    def refine(*_: object) -> tuple[CloseUps, Refined]:
        raise AssertionError

    (seen,) = objects(of, SQUARE, CRITERIA, FACTS.names, masks=False, refine=refine)
    assert seen.mask is None
    unsure = output([(20, 36, 8, 8)], [(0.01, 0)], np.ones((1, 16, 16), np.float32), [[1]])
    assert objects(unsure, SQUARE, CRITERIA, FACTS.names, masks=True, refine=refine) == []


def looks(*windows: tuple[int, int, int, int]) -> CloseUps:
    """Return close-ups of which nobody looks at more than the windows."""
    count = len(windows)
    pixels, features = np.full((count, SIDE, SIDE, 6), 255, np.uint8), np.zeros((count, 32, 32, 1), np.float32)
    return CloseUps(pixels, features, np.zeros(count, np.int64), np.ones(count, np.float32), np.array(windows))


def judged(odds: NDArray[np.float32], quality: float = 0.75) -> Refined:
    """Return masks that are all as good."""
    return Refined(odds, np.full(len(odds), quality, np.float32))
