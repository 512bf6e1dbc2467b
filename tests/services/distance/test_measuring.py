import msgspec
import numpy as np
import pytest

from schemas.detections import Mask
from schemas.distances import Measured, ObjectDistance
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView, Frame, measure, measure_apart, unknown
from services.geometry.depth import Depth
from services.geometry.errors import CalibrationError
from services.geometry.masks import MEASURED_PIXELS
from services.simulator.world import Camera, Drive, generate, render
from tests.schemas.masks import coco_mask
from tests.services.detector.support.views import NEAR_VIEWS
from tests.services.detector.support.views import View as Near
from tests.services.distance.scenes import FRAME, HEIGHT, WIDTH, found, mask, wall
from tests.services.geometry.cameras import LENSES, camera

ROWS, COLUMNS = slice(10, 30), slice(20, 50)
NAN = float("nan")


def view(depth: object, lens: str = "none", *frames: Frame) -> DepthView:
    return DepthView(Depth(np.asarray(depth, np.float32)), FRAME, camera(lens=LENSES[lens]), frames)


def known(of: ObjectDistance) -> Measured:
    assert of.measured is not None, of.unknown
    return of.measured


def test_a_flat_object_before_a_wall() -> None:
    depth = wall(4.0)
    depth[ROWS, COLUMNS] = 2.0
    (box,) = measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria())
    measured = known(box)
    assert (box.name, box.index, box.valid_share) == ("box", 0, 1.0)
    assert (measured.axial_m, measured.mean_m, measured.nearest_m, measured.spread_m) == (2.0, 2.0, 2.0, 0.0)
    (place,) = measured.places
    assert place.frame_id == FRAME
    assert place.at == pytest.approx((2 * (34.5 - 31.5) / 50, 2 * (19.5 - 23.5) / 50, 2.0), abs=0.01)


def test_an_object_keeps_its_track_whether_its_distance_is_known_or_not() -> None:
    depth = wall(4.0)
    depth[:9] = NAN
    objects = found(mask(ROWS, COLUMNS), mask(slice(0, 8), COLUMNS))
    tracked = [msgspec.structs.replace(each, track=track) for track, each in enumerate(objects, start=7)]
    near, far = measure(tracked, view(depth), Criteria())
    assert (near.measured is not None, far.measured is not None) == (True, False)
    assert (near.track, far.track) == (7, 8)


def test_straight_distance_is_longer_than_that_along_the_axis_off_the_axis() -> None:
    corner = mask(slice(0, 9), slice(0, 9))
    measured = known(measure(found(corner), view(wall(2.0)), Criteria())[0])
    assert measured.axial_m == 2
    assert measured.euclidean_m == pytest.approx(
        2 * np.sqrt(1 + ((31.5 - 4) / 50) ** 2 + ((23.5 - 4) / 50) ** 2), abs=0.01
    )


@pytest.mark.parametrize("lens", ["plumb_bob", "fish"])
def test_the_lens_counts(lens: str) -> None:
    seen = camera(lens=LENSES[lens])
    measured = known(measure(found(mask(slice(2, 7), slice(50, 60))), view(wall(3.0), lens), Criteria())[0])
    assert measured.places[0].at == pytest.approx(seen.unproject([[54.5, 4]], [3])[0].tolist(), abs=0.02)


def test_background_that_shows_through_a_pallets_gaps_does_not_count() -> None:
    depth = wall(4.0)
    depth[ROWS, COLUMNS] = 2.0
    for first in range(21, 49, 4):
        depth[12:28, first : first + 2] = 4.0  # gaps, within the mask
    measured = known(measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria())[0])
    assert measured.axial_m == 2
    assert measured.mean_m > 2.5  # as the guide has it
    assert measured.places[0].at is not None
    assert measured.places[0].at[2] == pytest.approx(2)


def test_a_mask_that_is_too_large_does_not_count() -> None:
    depth = wall(5.0)
    depth[14:26, 26:44] = 2.0
    measured = known(measure(found(mask(slice(11, 29), slice(23, 47))), view(depth), Criteria())[0])
    assert measured.axial_m == 2


def test_something_before_the_object_does_not_count() -> None:
    depth = wall(6.0)
    depth[ROWS, COLUMNS] = 4.0
    depth[:, 42:64] = 1.0  # hides a third of it, and goes on outside
    measured = known(measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria())[0])
    assert measured.axial_m == 4


def test_a_deep_object_is_measured_in_its_middle() -> None:
    depth = wall(9.0)
    depth[ROWS, COLUMNS] = np.linspace(2, 3, 30)
    measured = known(measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria(edge=0))[0])
    assert measured.axial_m == pytest.approx(2.5, abs=0.02)
    assert measured.nearest_m == pytest.approx(2.0, abs=0.04)
    assert measured.spread_m == pytest.approx(1.4826 / 4, abs=0.02)


@pytest.mark.parametrize(("lost", "axial_m"), [(1, 3), (2, 3), (4, 3), (5, 2)])
def test_readings_that_are_lost_count_as_those_beside_them(lost: int, axial_m: float) -> None:
    depth = wall(6.0)
    depth[ROWS, 20:34] = 2.0
    depth[ROWS, 34:50] = 3.0
    for first in range(35, 50, lost + 1):
        depth[ROWS, first : first + lost] = NAN
    assert known(measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria())[0]).axial_m == axial_m


def test_a_few_readings_of_a_large_object_are_enough() -> None:
    depth = np.full((HEIGHT, WIDTH), NAN)
    depth[20:23, 20:30] = 2.0
    whole = mask(slice(0, HEIGHT), slice(0, WIDTH))
    assert known(measure(found(whole), view(depth), Criteria(min_pixels=30))[0]).axial_m == 2


def test_places_in_further_frames() -> None:
    moved = np.identity(4)
    moved[:3, 3] = (10, 0, 1)
    frames = (Frame("base_link", moved), Frame("map", "nothing is known of frame 'map'"))
    measured = known(measure(found(mask(ROWS, COLUMNS)), view(wall(2.0), "none", *frames), Criteria())[0])
    own, base, of_map = measured.places
    assert own.at is not None
    assert base.at == pytest.approx((own.at[0] + 10, own.at[1], 3.0))
    assert (of_map.at, of_map.unknown) == (None, "nothing is known of frame 'map'")


def test_a_transform_to_nowhere_makes_no_result_that_nobody_can_read() -> None:
    vast = np.identity(4)
    vast[0, 3] = 1e10
    seen = view(wall(2.0), "none", Frame("map", vast))
    measured = known(measure(found(mask(ROWS, COLUMNS)), seen, Criteria())[0])
    assert measured.places[1].unknown == "more than 1e+09 m away according to the transforms"


def test_without_a_calibration_there_is_a_distance_and_no_place() -> None:
    seen = DepthView(Depth(wall(2.0)), FRAME, "no camera info arrived", (Frame("map", np.identity(4)),))
    measured = known(measure(found(mask(ROWS, COLUMNS)), seen, Criteria())[0])
    assert (measured.axial_m, measured.euclidean_m) == (2.0, None)
    assert [(place.frame_id, place.unknown) for place in measured.places] == [
        (FRAME, "no camera info arrived"),
        ("map", "no camera info arrived"),
    ]


def test_too_few_readings_are_unknown_and_just_enough_are_not() -> None:
    depth = np.full_like(wall(), NAN)
    depth[10, 20:49] = 2.0
    (few,) = measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria(min_pixels=30))
    assert few.measured is None
    assert few.unknown == "29 of its 600 pixels have a reading, 30 are needed"
    assert few.valid_share == pytest.approx(29 / 600)
    depth[10, 49] = 2.0
    assert known(measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria(min_pixels=30))[0]).axial_m == 2


@pytest.mark.parametrize("around", ["wall", "floor"])
def test_an_object_that_gives_no_depth_is_not_where_the_things_around_it_are(around: str) -> None:
    depth = wall(4.0) if around == "wall" else np.linspace(6, 2, HEIGHT)[:, np.newaxis].repeat(WIDTH, axis=1)
    depth[12:28, 22:48] = NAN  # the object; its mask is two pixels too large
    (black,) = measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria())
    assert black.measured is None
    assert (
        black.unknown == "184 of its 600 pixels have a reading, all from its surroundings: it returns no depth itself"
    )
    assert black.valid_share == pytest.approx(184 / 600)
    depth[12:28, 22:48] = 2.5
    assert known(measure(found(mask(ROWS, COLUMNS)), view(depth), Criteria())[0]).axial_m == 2.5


def test_objects_without_a_mask_or_with_a_damaged_or_empty_one_are_unknown() -> None:
    whole, other = found(mask(ROWS, COLUMNS), mask(ROWS, slice(0, 0)))
    bare = msgspec.structs.replace(whole, mask=None)
    damaged = msgspec.structs.replace(whole, mask=Mask((48, 64), "zz"))
    seen = measure([bare, whole, damaged, other], view(wall(2.0)), Criteria())
    assert [each.index for each in seen] == [0, 1, 2, 3]
    assert seen[0].unknown == "the model gives no masks"
    assert known(seen[1]).axial_m == 2
    assert "runs" in seen[2].unknown
    assert seen[3].unknown == "0 of its 0 pixels have a reading, 30 are needed"


def test_an_object_that_cannot_be_measured_costs_no_other() -> None:
    sound = found(mask(ROWS, COLUMNS), mask(ROWS, COLUMNS))
    beyond = msgspec.structs.replace(sound[0], mask=coco_mask(np.ones((HEIGHT + 1, WIDTH), np.bool_)))
    objects = [sound[0], beyond, sound[1]]
    seen = measure_apart(objects, view(wall(2.0)), Criteria())
    assert [each.index for each in seen] == [0, 1, 2]
    assert [each.measured is None for each in seen] == [False, True, False]
    assert seen[1].unknown.startswith("it failed: ValueError(")
    assert [seen[0], msgspec.structs.replace(seen[2], index=1)] == measure(sound, view(wall(2.0)), Criteria())


def test_objects_measured_alone_share_the_pixels_of_one_image(monkeypatch: pytest.MonkeyPatch) -> None:
    beyond = msgspec.structs.replace(
        found(mask(ROWS, COLUMNS))[0], mask=coco_mask(np.ones((HEIGHT + 1, WIDTH), np.bool_))
    )
    large, small = found(mask(slice(0, HEIGHT), slice(0, WIDTH)), mask(ROWS, COLUMNS))
    monkeypatch.setattr("services.distance.measuring.MEASURED_PIXELS", 3 * HEIGHT * WIDTH - 3)
    seen = measure_apart([large, beyond, small], view(wall(2.0)), Criteria())
    assert [each.measured is None for each in seen] == [True, True, False]
    assert "million pixels together" in seen[0].unknown


def test_only_so_many_pixels_of_an_images_masks_are_measured() -> None:
    everywhere = mask(slice(0, HEIGHT), slice(0, WIDTH))
    fitting = MEASURED_PIXELS // (HEIGHT * WIDTH)
    small = mask(ROWS, COLUMNS)
    measured = measure_apart(found(*[everywhere] * (fitting + 5), small), view(wall(2.0)), Criteria())
    assert [each.measured is not None for each in measured[:-1]] == [True] * fitting + [False] * 5
    assert measured[fitting].unknown == "the masks in one image cover over 33.6 million pixels together"


def test_a_large_mask_is_measured_at_every_nth_row_and_column(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    depth = wall(4.0)
    depth[ROWS, COLUMNS] = 2.0 + rng.normal(0, 0.01, (20, 30))
    depth[ROWS, 30:35] = NAN
    objects = found(mask(ROWS, COLUMNS), mask(slice(0, 4), slice(0, 4)))
    whole, tiny = measure(objects, view(depth), Criteria(edge=1))
    monkeypatch.setattr("services.distance.measuring.AT_ONCE", 200)
    thin, same = measure(objects, view(depth), Criteria(edge=1))
    assert tiny == same
    assert thin.valid_share == pytest.approx(whole.valid_share, abs=0.05)
    assert known(thin).axial_m == pytest.approx(known(whole).axial_m, abs=0.005)
    assert known(thin).spread_m == pytest.approx(known(whole).spread_m, abs=0.005)
    assert known(thin).places[0].at == pytest.approx(known(whole).places[0].at, abs=0.05)
    nowhere = measure(found(mask(ROWS, COLUMNS)), view(np.full_like(depth, NAN)), Criteria())[0]
    assert nowhere.unknown == "0 of its 640 pixels have a reading, 30 are needed"  # 40 that each stand for 16


def test_nothing_in_view() -> None:
    assert measure([], view(wall()), Criteria()) == []


def test_pixels_that_look_nowhere_have_a_depth_and_no_place() -> None:
    folded = camera(lens=("plumb_bob", [-0.9, 0.0, 0.0, 0.0, 0.0]))
    seen = DepthView(Depth(wall(2.0)), FRAME, folded)
    measured = known(measure(found(mask(slice(0, 8), slice(0, 8))), seen, Criteria())[0])
    assert (measured.axial_m, measured.euclidean_m) == (2.0, None)
    assert "gives its pixels no direction" in measured.places[0].unknown


def test_where_only_scattered_readings_look_somewhere_the_place_is_of_these() -> None:
    folded = camera(lens=("plumb_bob", [-0.9, 0.0, 0.0, 0.0, 0.0]))
    depth = np.full_like(wall(), NAN)
    depth[:8, :8] = 2.0
    depth[20:28, 30:35] = np.geomspace(3, 20, 40).reshape(8, 5)
    both = mask(slice(0, 8), slice(0, 8)) | mask(slice(20, 28), slice(30, 35))
    measured = known(measure(found(both), DepthView(Depth(depth), FRAME, folded), Criteria())[0])
    (place,) = measured.places
    assert place.at is not None
    assert 7 < place.at[2] < 11


def test_a_lens_that_sees_beyond_all_distances_makes_no_result_that_nobody_can_read() -> None:
    seen = DepthView(Depth(wall(5_000.0)), FRAME, camera(focal=1e-3))
    measured = known(measure(found(mask(ROWS, slice(0, 20))), seen, Criteria())[0])
    assert (measured.axial_m, measured.euclidean_m) == (5_000, None)
    assert "gives its pixels no direction" in measured.places[0].unknown


def test_a_camera_of_another_size_is_refused() -> None:
    with pytest.raises(CalibrationError, match="calibrated for 64x48"):
        measure(
            found(mask(ROWS, COLUMNS)), DepthView(Depth(np.zeros((24, 32), np.float32)), FRAME, camera()), Criteria()
        )


def test_a_reason_for_all() -> None:
    seen = unknown(found(mask(ROWS, COLUMNS), mask(ROWS, ROWS), names=("box", "pallet")), "no depth image arrived")
    assert [(each.name, each.index, each.valid_share, each.unknown) for each in seen] == [
        ("box", 0, 0.0, "no depth image arrived"),
        ("pallet", 1, 0.0, "no depth image arrived"),
    ]


@pytest.mark.parametrize("near", NEAR_VIEWS)
def test_objects_of_the_rendered_warehouse(near: Near) -> None:
    scene = generate(near.seed)
    seen = render(scene, Drive.plan(scene).pose(near.fraction), Camera())
    instances, counts = np.unique(seen.instances[seen.instances > 0], return_counts=True)
    masks = [seen.instances == each for each in instances[counts >= 200]]
    masks = [each for each in masks if np.median(seen.depth[each]) <= 8]
    truth = np.array([np.median(seen.depth[each]) for each in masks])
    noise = np.random.default_rng(1).normal(0, 0.001, seen.depth.shape) * seen.depth**2
    depth = np.where(seen.depth > 0, seen.depth + noise, NAN)
    lens = camera(height=480, width=640, focal=465.6)
    measured = measure(found(*masks), DepthView(Depth(depth.astype(np.float32)), FRAME, lens), Criteria())
    axial = np.array([known(each).axial_m for each in measured])
    assert np.abs(axial / truth - 1).mean() < 0.005


def test_an_object_that_fills_the_picture_has_nothing_around_it() -> None:
    depth = wall(2.0)
    depth[:, 32:] = 5.0
    whole = found(mask(slice(0, 48), slice(0, 64)), mask(ROWS, COLUMNS))
    first, _ = measure(whole, view(depth), Criteria())
    assert known(first).axial_m in {2.0, 3.5, 5.0}
    assert known(first).mean_m == pytest.approx(3.5)
