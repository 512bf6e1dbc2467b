import numpy as np
import pytest

from services.simulator.world import Camera, Drive, Scene, generate, render
from services.simulator.world.clearance import Clearance
from services.simulator.world.drive import ROBOT_RADIUS

SEEDS = range(700, 712)


@pytest.fixture(scope="module")
def drives() -> list[tuple[Scene, Drive]]:
    scenes = [generate(seed) for seed in SEEDS]
    return [(scene, Drive.plan(scene)) for scene in scenes]


def test_no_pose_is_within_a_robots_radius_of_anything(drives: list[tuple[Scene, Drive]]) -> None:
    for scene, drive in drives:
        clearance = Clearance.of(scene)
        for fraction in np.linspace(0, 1, 97):
            assert clearance.at(drive.pose(float(fraction)).position[:2]) > ROBOT_RADIUS


def test_no_camera_is_inside_a_cuboid(drives: list[tuple[Scene, Drive]]) -> None:
    for scene, drive in drives:
        for fraction in np.linspace(0, 1, 60, endpoint=False):
            offset = drive.pose(float(fraction)).position - scene.cuboids.centres
            local = np.einsum("kij,ki->kj", scene.cuboids.rotations, offset)
            assert not (np.abs(local) <= scene.cuboids.half_extents).all(axis=1).any()


def test_the_way_is_closed_and_has_no_jumps(drives: list[tuple[Scene, Drive]]) -> None:
    for _, drive in drives:
        steps = np.hypot(*(np.roll(drive.points, -1, axis=0) - drive.points).T)
        assert steps.max() < 0.1
        turns = (np.roll(drive.headings, -1) - drive.headings + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(turns).max() < 0.4
        assert drive.length > 5


def test_a_fraction_and_the_next_round_are_the_same_pose(drives: list[tuple[Scene, Drive]]) -> None:
    drive = drives[0][1]
    for fraction in (0.0, 0.37):
        assert drive.pose(fraction).position == pytest.approx(drive.pose(fraction + 1).position, abs=1e-4)
        assert drive.pose(fraction).rotation == pytest.approx(drive.pose(fraction + 1).rotation, abs=1e-4)


def test_the_same_seeds_give_the_same_drive_and_others_another() -> None:
    scene = generate(700)
    assert np.array_equal(Drive.plan(scene, 1).points, Drive.plan(scene, 1).points)
    assert not np.array_equal(Drive.plan(scene, 1).points, Drive.plan(scene, 2).points)


def test_something_large_is_in_view_most_of_the_time(drives: list[tuple[Scene, Drive]]) -> None:
    camera = Camera.with_field_of_view(80, 60, 1.2)
    seen = [
        np.bincount(render(scene, drive.pose(index / 6), camera).instances.ravel())[1:].max(initial=0) > 48
        for scene, drive in drives[:6]
        for index in range(6)
    ]
    assert np.mean(seen) > 0.8
