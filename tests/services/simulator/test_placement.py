import numpy as np
import pytest

from services.geometry.rotation import quaternion_of
from services.simulator.placement import (
    BASE,
    CAMERA,
    COLOR_OPTICAL,
    DEPTH_OPTICAL,
    LIDAR,
    at,
    odometry_error,
    of_pose,
    rig,
    to_pose,
)
from services.simulator.world import Pose


def test_the_colour_camera_is_where_its_height_and_pitch_say() -> None:
    found = rig(0.7, -0.1).on_robot(COLOR_OPTICAL)
    expected = of_pose(Pose.looking(0.15, 0.015, 0.7, yaw=0.0, pitch=-0.1))
    assert np.allclose(found, expected, atol=1e-7)


def test_depth_is_seen_from_beside_and_the_lidar_from_above() -> None:
    mounted = rig(0.7, -0.1)
    apart = np.linalg.inv(mounted.on_robot(DEPTH_OPTICAL)) @ mounted.on_robot(COLOR_OPTICAL)
    assert np.allclose(apart, at(-0.015))
    assert np.allclose(mounted.on_robot(LIDAR), at(z=1.0))
    assert np.array_equal(mounted.on_robot(BASE), np.eye(4))


def test_every_frame_hangs_on_base_link() -> None:
    joints = rig(0.7, -0.1).static()
    assert {child for _, child, _ in joints} >= {CAMERA, COLOR_OPTICAL, DEPTH_OPTICAL, LIDAR}
    assert {parent for parent, _, _ in joints} - {child for _, child, _ in joints} == {BASE}


def test_a_pose_and_its_placement_are_the_same() -> None:
    pose = Pose.looking(1.5, -2.0, 0.6, yaw=2.8, pitch=0.1)
    again = to_pose(of_pose(pose))
    assert np.array_equal(again.position, pose.position)
    assert np.array_equal(again.rotation, pose.rotation)


def test_odometry_errs_on_the_way_and_is_back_after_a_round() -> None:
    assert np.allclose(odometry_error(0.0), np.eye(4))
    assert np.allclose(odometry_error(1.0), np.eye(4))
    assert np.linalg.norm(odometry_error(0.25)[:2, 3]) == pytest.approx(0.2 * 2**0.5)


def test_the_quaternion_of_the_optical_frame_is_the_known_one() -> None:
    optical = rig(0.7, 0.0).on_robot(COLOR_OPTICAL)
    assert quaternion_of(optical) == pytest.approx((-0.5, 0.5, -0.5, 0.5))
