import numpy as np
import pytest

from services.distance.depth_in_color_view import Instant
from services.distance.sensor_history import SensorHistory
from services.worker.stamp_joiner import Joiner
from tests.services.distance.scenes import FRAME, calibration, depth, detections, stamp_of, transforms, wall


def sensed(*frames: str) -> SensorHistory:
    return SensorHistory(frames, Joiner("depth image", tolerance_ns=10_000_000))


def keep(into: SensorHistory, seq: int, **more: str) -> None:
    frame = depth(wall(), seq, **more)
    into.depths.keep(frame.header.stamp_ns, frame, frame.data.nbytes)


def test_depth_of_the_instant_and_what_else_is_known() -> None:
    made = sensed()
    made.info, made.depth_info = calibration(), calibration()
    for seq in (1, 2, 3):
        keep(made, seq)
    moment = made.at(detections([], 2))
    assert not moment.open
    assert isinstance(moment.instant, Instant)
    assert moment.instant.depth.header.seq == 2
    assert moment.instant.info is made.info
    assert isinstance(moment.instant.color_from_depth, np.ndarray)


def test_a_slash_before_a_frames_name_makes_no_other_frame_of_it() -> None:
    made = sensed("/camera")
    keep(made, 1, frame_id="/camera")
    moment = made.at(detections([], 1, frame_id="camera"))
    assert isinstance(moment.instant, Instant)
    assert isinstance(moment.instant.color_from_depth, np.ndarray)
    assert isinstance(moment.frames[0].from_camera, np.ndarray)


def test_no_depth_yet_or_none_of_the_instant() -> None:
    made = sensed()
    moment = made.at(detections([], 5))
    assert (moment.instant, moment.open) == ("no depth image arrived", True)
    keep(made, 4)
    assert made.at(detections([], 5)).open
    keep(made, 6)
    moment = made.at(detections([], 5))
    assert not moment.open
    assert "no depth image of its instant" in str(moment.instant)


def test_depth_of_the_image_before_is_taken_only_where_its_own_does_not_come() -> None:
    made = SensorHistory((), Joiner("depth image", tolerance_ns=70_000_000))
    for seq in (1, 2, 3):
        keep(made, seq)
    moment = made.at(detections([], 4))
    assert moment.open
    assert isinstance(moment.instant, Instant)
    assert moment.instant.depth.header.seq == 3
    keep(made, 4)
    moment = made.at(detections([], 4))
    assert not moment.open
    assert isinstance(moment.instant, Instant)
    assert moment.instant.depth.header.seq == 4


def test_an_image_without_a_stamp_is_of_no_instant() -> None:
    made = sensed("map")
    keep(made, 1)
    moment = made.at(detections([], 1, stamp_ns=0))
    assert (moment.instant, moment.open) == ("the image has no stamp", False)


def test_frames_at_the_images_stamp() -> None:
    made = sensed("base_link", "map")
    keep(made, 1)
    made.transforms.take(transforms(("base_link", FRAME, 0.5)), static=True)
    base, of_map = made.at(detections([], 1)).frames
    assert isinstance(base.from_camera, np.ndarray)
    assert base.from_camera[0, 3] == 0.5
    assert of_map.from_camera == "nothing is known of frame 'map'"


def test_a_transform_that_is_not_known_yet_may_be_waited_for_and_one_that_never_will_be_not() -> None:
    made = sensed("map")
    keep(made, 5)
    made.transforms.take(transforms(("map", FRAME, 1.0), stamp_ns=stamp_of(4)), static=False)
    moment = made.at(detections([], 5))
    assert moment.open
    assert "is known until 0.033 s before the stamp" in str(moment.frames[0].from_camera)
    made.transforms.take(transforms(("map", FRAME, 2.0), stamp_ns=stamp_of(6)), static=False)
    moment = made.at(detections([], 5))
    assert not moment.open
    assert isinstance(moment.frames[0].from_camera, np.ndarray)
    assert moment.frames[0].from_camera[0, 3] == pytest.approx(1.5)


def test_where_a_robot_is_in_the_map_is_not_waited_for_once_nobody_says_it_any_more() -> None:
    made = sensed("map")
    keep(made, 35)
    made.transforms.take(transforms(("map", FRAME, 1.0), stamp_ns=stamp_of(4)), static=False)
    moment = made.at(detections([], 35))
    assert not moment.open
    assert "is known until 1.023 s before the stamp" in str(moment.frames[0].from_camera)


def test_depth_in_another_frame_needs_the_transform_between_the_two() -> None:
    made = sensed()
    keep(made, 1, frame_id="camera_depth_optical_frame")
    moment = made.at(detections([], 1))
    assert isinstance(moment.instant, Instant)
    assert "nothing is known of frame" in str(moment.instant.color_from_depth)
    made.transforms.take(transforms((FRAME, "camera_depth_optical_frame", 0.02)), static=True)
    moment = made.at(detections([], 1))
    assert isinstance(moment.instant, Instant)
    assert isinstance(moment.instant.color_from_depth, np.ndarray)
    assert moment.instant.color_from_depth[0, 3] == 0.02


def test_where_a_depth_camera_is_that_moves_may_be_waited_for_too() -> None:
    made = sensed()
    keep(made, 5, frame_id="lens")
    made.transforms.take(transforms((FRAME, "lens", 1.0), stamp_ns=stamp_of(4)), static=False)
    moment = made.at(detections([], 5))
    assert moment.open
    made.transforms.take(transforms((FRAME, "lens", 2.0), stamp_ns=stamp_of(6)), static=False)
    moment = made.at(detections([], 5))
    assert not moment.open
    assert isinstance(moment.instant, Instant)
    assert isinstance(moment.instant.color_from_depth, np.ndarray)
    assert moment.instant.color_from_depth[0, 3] == pytest.approx(1.5)
