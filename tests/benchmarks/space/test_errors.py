from functools import cache

import numpy as np
import pytest

from benchmarks.space import errors, guide, paths
from benchmarks.space.matching import matched
from benchmarks.space.messages import true_detections
from benchmarks.space.views import SpaceView, is_asked_for, seeds, view_of
from schemas.distances import ObjectDistance
from services.training.dataset import HOLDOUT_OFFSET, SEEDS_PER_RUN
from services.training.evaluation.scenes import held_out_seeds


@cache
def view() -> SpaceView:
    """Return one with objects of each size."""
    return view_of(seeds(1)[0])


def test_no_training_run_and_no_other_evaluation_has_these_scenes() -> None:
    made = seeds(500)
    assert len(set(made)) == 500
    assert all(seed % SEEDS_PER_RUN >= HOLDOUT_OFFSET for seed in made)
    assert not set(made) & set(held_out_seeds(1, 10_000))


def test_a_view_is_the_same_every_time_whatever_is_measured_first() -> None:
    again = view_of(view().scene.seed)
    assert (again.depth == view().depth).all()
    assert (again.image == view().image).all()


def test_true_masks_are_matched_with_their_own_objects() -> None:
    objects = view().every_object
    found = true_detections(view().objects)
    matches = matched(found, objects)
    assert [matches[place].instance for place in range(len(found))] == [seen.instance for seen in view().objects]
    assert matched([], objects) == matched(found, []) == {}


def test_the_second_detection_of_an_object_is_of_none() -> None:
    (found, *_) = true_detections(view().objects)
    assert matched([found, found], view().every_object).keys() == {0}


def test_what_is_measured_with_true_masks_is_nearly_true() -> None:
    truths = dict(enumerate(view().objects))
    found = true_detections(view().objects)
    assert all(is_asked_for(seen) for seen in truths.values())
    assert np.median(list(errors.distance(paths.distances(view(), found), truths))) < 0.01
    assert np.median(list(errors.distance(paths.distances(view(), found, registered=False), truths))) < 0.02
    samples = errors.Samples(list)
    errors.add_clouds(view(), paths.clouds(view(), found), truths, "", samples)
    assert np.median(samples["centroid_excess"]) < 0
    assert np.median(samples["foreign_points"]) < 0.01
    assert len(samples["missing_clouds"]) == len(truths)


def test_what_is_unknown_is_counted_and_no_error() -> None:
    truths = dict(enumerate(view().objects))
    measured = [ObjectDistance(name=seen.name, index=0, valid_share=0, unknown="dark") for seen in truths.values()]
    assert list(errors.distance(measured, truths)) == []
    assert list(errors.unknown(measured, truths)) == [1.0] * len(truths)


def test_a_cloud_of_another_object_is_foreign_and_off() -> None:
    near, *_, far = sorted(view().objects, key=lambda seen: seen.depth_m)
    (cloud,) = paths.clouds(view(), true_detections([near])).objects
    assert errors.foreign(cloud, view(), far) == 1
    assert errors.centroid(cloud, far) > 0


def test_the_guides_formula_takes_missing_readings_for_distances() -> None:
    masks = np.zeros((2, 2, 2), np.float32)
    masks[0, 0] = 1
    assert guide.distances(masks, np.array([[2000, 0], [9, 9]], np.uint16)) == [1000.0, np.inf]
    assert guide.distances(masks, np.array([[2.0, np.nan], [9, 9]], np.float32)) == [2.0, np.inf]


def test_the_guides_clouds_keep_what_is_not_the_object_at_the_origin() -> None:
    points = np.zeros((2, 2), [(name, "<f4") for name in ("x", "y", "z", "rgb")])
    points["z"] = [[1, 2], [3, np.nan]]
    xyz, rgb = guide.read_cloud(memoryview(points.tobytes()), points.dtype, 2, 2)
    assert (xyz.shape, rgb.shape) == ((2, 2, 3), (2, 2, 3))
    mask = np.array([[[0, 1], [0, 0]]], np.float32)
    ((made, colours),) = guide.clouds(mask, xyz, rgb)
    assert made[:, 2].tolist()[:3] == [0, 2, 0]
    assert colours.shape == (4, 3)
    assert made[0, 0] == pytest.approx(0)
