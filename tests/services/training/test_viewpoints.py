import numpy as np

from services.simulator.world import generate
from services.simulator.world.clearance import Clearance
from services.training.viewpoints import ROBOT_RADIUS, draw_camera, draw_pose


def test_poses_are_low_and_outside_of_things() -> None:
    scene, rng = generate(3), np.random.default_rng(0)
    clearance = Clearance.of(scene)
    for _ in range(100):
        x, y, z = draw_pose(scene, clearance, rng).position
        assert 0.4 <= z <= 1.2
        assert clearance.at((x, y)) > ROBOT_RADIUS


def test_cameras_are_of_the_size_the_robots_send() -> None:
    camera = draw_camera(np.random.default_rng(0))
    assert (camera.width, camera.height) == (640, 480)
    assert 55 < np.degrees(2 * np.arctan(320 / camera.fx)) < 82
