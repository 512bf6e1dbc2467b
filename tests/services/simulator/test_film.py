import numpy as np
import pytest

from services.simulator.film import Equipment, Film, Part
from services.simulator.placement import COLOR_OPTICAL, of_pose, to_pose
from services.simulator.store import Store
from services.simulator.world import Drive, Pose, Sensor, expose, generate, render
from tests.services.simulator.small import ALIGNED, COLOR, DEPTH, FRAMES, PLENTY, UNALIGNED, film

EVERYTHING = frozenset(Part)


def pose_of(found: Film, number: int) -> Pose:
    """Return the pose of the colour camera as transforms say it."""
    return to_pose(found.robot(number) @ found.rig.on_robot(COLOR_OPTICAL))


@pytest.mark.parametrize("part", Part)
def test_the_same_seed_is_the_same_film_and_another_is_not(part: Part) -> None:
    again, other = Film(1, ALIGNED, FRAMES, Store(PLENTY)), film(seed=2)
    for number in (2, 0):
        first = film().measure(number, {part})[part]
        assert first.tobytes() == again.measure(number, {part})[part].tobytes()
        assert first.tobytes() != other.measure(number, {part})[part].tobytes()


def test_measurements_move_and_start_over() -> None:
    first, second, around = (film().measure(number, EVERYTHING) for number in (0, 1, FRAMES))
    for part in Part:
        assert first[part].tobytes() != second[part].tobytes()
        assert first[part].tobytes() == around[part].tobytes()


def test_what_is_not_kept_is_measured_again_and_is_the_same() -> None:
    forgetful = Film(1, ALIGNED, FRAMES, Store(0))
    assert forgetful.store.size == 0
    for _ in range(2):
        found = forgetful.measure(1, EVERYTHING)
        assert all(found[part].tobytes() == film().measure(1, {part})[part].tobytes() for part in Part)


def test_only_what_is_asked_for_is_measured() -> None:
    fresh = Film(1, ALIGNED, FRAMES, Store(PLENTY))
    assert fresh.measure(0, frozenset()) == {}
    assert fresh.store.size == 0
    assert fresh.measure(0, {Part.DEPTH}).keys() == {Part.DEPTH}


@pytest.mark.parametrize("number", range(FRAMES))
def test_the_picture_is_what_is_seen_from_where_transforms_put_the_camera(number: int) -> None:
    scene = generate(1)
    pose = pose_of(film(), number)
    assert np.allclose(of_pose(pose), of_pose(Drive.plan(scene).pose(number / FRAMES)), atol=1e-6)
    seen = expose(render(scene, pose, COLOR).color, Sensor(), np.random.default_rng((1, number)))
    picture = film().measure(number, {Part.COLOR})[Part.COLOR]
    assert picture.shape == (48, 64, 3)
    assert np.mean(np.abs(seen.astype(int) - picture) > 2) < 0.01  # rounding moves the edge of a surface by a pixel


def test_the_robot_stands_on_the_floor() -> None:
    for number in range(FRAMES):
        robot = film().robot(number)
        assert robot[2, 3] == pytest.approx(0, abs=1e-6)
        assert robot[2, :3] == pytest.approx([0, 0, 1], abs=1e-6)


@pytest.mark.parametrize("equipment", [ALIGNED, UNALIGNED])
def test_depth_is_seen_through_its_own_camera(equipment: Equipment) -> None:
    seen = film(equipment)
    measured = seen.measure(0, {Part.DEPTH})[Part.DEPTH]
    camera = COLOR if equipment.aligned else DEPTH
    pose = to_pose(seen.robot(0) @ seen.rig.on_robot(equipment.depth_frame))
    exact = render(generate(1), pose, camera).depth
    assert measured.shape == (camera.height, camera.width)
    assert measured.dtype == np.uint16
    there = measured > 0
    assert there.mean() > 0.3
    assert np.median(np.abs(measured[there] / 1000 - exact[there]) / exact[there]) < 0.15
