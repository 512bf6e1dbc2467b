"""Objects with keypoints: where each keypoint is, and how far an object without a mask is."""

import msgspec
import numpy as np
import pytest

from schemas.detections import Detection, Keypoint
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView, Frame, measure
from services.geometry.depth import Depth
from tests.services.distance.scenes import FRAME, found, mask, wall
from tests.services.distance.test_measuring import COLUMNS, NAN, ROWS, known, view


def test_keypoints_are_placed_on_the_surface_that_is_nearest_and_the_objects() -> None:
    depth = wall(4.0)
    depth[ROWS, COLUMNS] = 2.0
    depth[20:22, 49:51] = 1.5  # a hand, at the silhouette
    points = [Keypoint(30, 20, 0.9), Keypoint(50, 20, 0.9), Keypoint(60, 40, 0.9), Keypoint(32, 22, 0.4)]
    person = [msgspec.structs.replace(found(mask(ROWS, COLUMNS))[0], keypoints=points)]
    shift = np.identity(4)
    shift[0, 3] = 10.0
    frames = (Frame("base", shift), Frame("map", "no transforms"))
    camera_place, base, nowhere = known(measure(person, view(depth, "none", *frames), Criteria())[0]).places
    trunk, hand, other, unsure = camera_place.keypoints
    assert trunk == pytest.approx((2 * (30 - 31.5) / 50, 2 * (20 - 23.5) / 50, 2.0))
    assert hand == pytest.approx((1.5 * (50 - 31.5) / 50, 1.5 * (20 - 23.5) / 50, 1.5))
    assert (other, unsure) == (None, None)
    assert base.keypoints[0] == pytest.approx((2 * (30 - 31.5) / 50 + 10, 2 * (20 - 23.5) / 50, 2.0))
    assert nowhere.keypoints == []


def person(*points: tuple[float, float, float], seen: bool = False) -> Detection:
    """Return a person with keypoints, and a mask if seen."""
    whole = found(mask(ROWS, COLUMNS))[0]
    return msgspec.structs.replace(
        whole, mask=whole.mask if seen else None, keypoints=[Keypoint(*each) for each in points]
    )


def test_an_object_without_a_mask_is_as_far_as_most_of_its_keypoints() -> None:
    depth = wall(4.0)
    depth[ROWS, COLUMNS] = 2.0
    depth[14:20, 30:36] = 1.0  # a parcel held before the trunk, on which one keypoint is
    points = [(24, 14, 0.9), (44, 14, 0.9), (33, 17, 0.9), (24, 26, 0.9), (44, 26, 0.9), (60, 40, 0.9), (30, 24, 0.1)]
    (one,) = measure([person(*points)], view(depth), Criteria())
    measured = known(one)
    assert (measured.axial_m, measured.nearest_m, measured.spread_m) == (2.0, 1.0, 0.0)
    assert measured.mean_m == pytest.approx(1.8)
    assert one.valid_share == pytest.approx(5 / 6)
    middle = measured.places[0].at
    assert middle is not None
    assert middle[2] == pytest.approx(1.8)
    assert [each is not None for each in measured.places[0].keypoints] == [True] * 5 + [False, False]
    assert measured.euclidean_m == pytest.approx(2.0, abs=0.2)


def test_too_few_keypoints_or_no_calibration() -> None:
    two = person((24, 14, 0.9), (44, 14, 0.9), (30, 24, 0.1))
    nothing = person((24, 14, 0.9), (44, 14, 0.9), (30, 24, 0.9))
    (few,) = measure([two], view(wall(2.0)), Criteria())
    assert few.unknown == "2 of its 2 keypoints in view have a reading near each other, 3 are needed"
    (none,) = measure([nothing], view(wall(NAN)), Criteria())
    assert none.unknown == "0 of its 3 keypoints in view have a reading near each other, 3 are needed"
    uncalibrated = DepthView(Depth(wall(2.0)), FRAME, "no calibration")
    (one,) = measure([nothing], uncalibrated, Criteria())
    assert (known(one).axial_m, known(one).euclidean_m) == (2.0, None)
    assert [(each.at, each.keypoints, each.unknown) for each in known(one).places] == [(None, [], "no calibration")]


def test_only_so_many_keypoints_of_one_image_are_looked_at() -> None:
    many = person(*[(24 + n % 20, 14 + n % 10, 0.9) for n in range(250)])
    seen = measure([many] * 81, view(wall(2.0)), Criteria())
    assert [each.measured is not None for each in seen] == [True] * 80 + [False]
    assert seen[-1].unknown == "the model gives no masks"
