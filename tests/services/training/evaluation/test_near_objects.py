import numpy as np
import pytest

from services.simulator.world import Camera, Drive, generate, render, truth_of
from services.training.evaluation.near_objects import (
    NEAR_AREA,
    NEAR_METRES,
    LabelledBox,
    box_iou,
    is_invented,
    match,
    near_objects,
)

TRUTH = LabelledBox("box", np.array([10.0, 10, 30, 30]))


def at(name: str, *box: float) -> LabelledBox:
    return LabelledBox(name, np.array(box))


def test_the_overlap_of_boxes() -> None:
    one = np.array((0.0, 0.0, 10.0, 10.0))
    assert box_iou(one, one) == 1
    assert box_iou(one, np.array((5.0, 0.0, 15.0, 10.0))) == pytest.approx(1 / 3)
    assert box_iou(one, np.array((10.0, 0.0, 20.0, 10.0))) == 0
    assert box_iou(np.array((3.0, 3.0, 3.0, 3.0)), np.array((3.0, 3.0, 3.0, 3.0))) == 0, "of no size"


def test_the_right_name_on_the_same_place_is_right() -> None:
    assert match(TRUTH, [at("box", 11, 10, 31, 30)]) == (True, False)


def test_the_wrong_name_on_the_same_place_is_wrong() -> None:
    assert match(TRUTH, [at("pallet", 10, 10, 30, 30)]) == (False, True)


def test_both_names_on_the_same_place_are_both() -> None:
    assert match(TRUTH, [at("pallet", 10, 10, 30, 30), at("box", 10, 10, 30, 30)]) == (True, True)


def test_elsewhere_or_nothing_is_neither() -> None:
    assert match(TRUTH, [at("box", 40, 40, 60, 60), at("pallet", 20, 20, 40, 40)]) == (False, False)
    assert match(TRUTH, []) == (False, False)


def test_half_an_overlap_is_enough() -> None:
    assert match(TRUTH, [at("box", 10, 10, 30, 20)]) == (True, False)
    assert match(TRUTH, [at("box", 10, 10, 30, 19)]) == (False, False)


def test_a_large_prediction_of_what_is_not_there_is_invented() -> None:
    classes = np.full((100, 100), -1, np.int32)
    classes[:20, :20] = 0
    assert is_invented(at("box", 50, 50, 70, 70), classes)
    assert is_invented(at("pallet", 0, 0, 20, 20), classes)
    assert not is_invented(at("box", 0, 0, 30, 30), classes)
    assert not is_invented(at("box", 50, 50, 59, 59), classes)


def test_near_objects_are_large_and_near() -> None:
    scene = generate(702)
    pose, camera = Drive.plan(scene).pose(0.5), Camera()
    seen = render(scene, pose, camera)
    found = near_objects(truth_of(scene, seen, pose, camera))
    assert found
    for each in found:
        left, top, right, bottom = each.box.astype(int)
        assert (right - left) * (bottom - top) >= NEAR_AREA * seen.instances.size
        assert seen.depth[top:bottom, left:right].min() <= NEAR_METRES
