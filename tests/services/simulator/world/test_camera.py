import numpy as np
import pytest

from services.simulator.world.camera import Camera, Pose


def test_the_default_camera_is_about_69_degrees_wide() -> None:
    camera = Camera()
    assert np.degrees(2 * np.arctan(camera.width / 2 / camera.fx)) == pytest.approx(69, abs=0.1)


def test_a_field_of_view_gives_square_pixels_and_a_centred_image() -> None:
    camera = Camera.with_field_of_view(64, 48, np.pi / 2)
    assert (camera.fx, camera.fy) == pytest.approx((32, 32))
    assert (camera.cx, camera.cy) == (31.5, 23.5)


@pytest.mark.parametrize(("yaw", "pitch"), [(0.0, 0.0), (2.0, 0.3), (-3.1, -0.5)])
def test_a_pose_is_a_level_right_handed_frame(yaw: float, pitch: float) -> None:
    pose = Pose.looking(1, 2, 0.5, yaw, pitch)
    right, down, forward = pose.rotation.T
    assert pose.rotation.T @ pose.rotation == pytest.approx(np.eye(3), abs=1e-6)
    assert np.cross(right, down) == pytest.approx(forward, abs=1e-6)
    assert right[2] == 0
    assert down[2] < 0
    assert forward == pytest.approx([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)], abs=1e-6)


def test_an_upright_frame_has_its_z_up() -> None:
    pose = Pose.upright(1, 2, 3, np.pi / 2)
    points = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert pose.to_map(points) == pytest.approx(np.array([[1, 3, 3], [0, 2, 3], [1, 2, 4]]), abs=1e-6)
