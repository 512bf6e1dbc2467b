import numpy as np
import pytest

from services.simulator.film import Array, Equipment, Film, Part, Store, smeared
from services.simulator.placement import COLOR_OPTICAL, of_pose, to_pose
from services.simulator.world import Camera, ChangingWorld, Drive, Pose, Sensor, expose, generate, render
from tests.services.simulator.small import ALIGNED, COLOR, DEPTH, FRAMES, HZ, PLENTY, UNALIGNED, film

EVERYTHING = frozenset(Part)


def pose_of(found: Film, number: int) -> Pose:
    """Return the pose of the colour camera as transforms say it."""
    return to_pose(found.robot(number) @ found.rig.on_robot(COLOR_OPTICAL))


@pytest.mark.parametrize("part", Part)
def test_the_same_seed_is_the_same_film_and_another_is_not(part: Part) -> None:
    again, other = Film(1, ALIGNED, FRAMES, HZ, Store(PLENTY)), film(seed=2)
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
    forgetful = Film(1, ALIGNED, FRAMES, HZ, Store(0))
    assert forgetful.store.size == 0
    for _ in range(2):
        found = forgetful.measure(1, EVERYTHING)
        assert all(found[part].tobytes() == film().measure(1, {part})[part].tobytes() for part in Part)


def test_a_changing_world_is_measured_as_it_is_at_the_time() -> None:
    world = ChangingWorld(generate(1), 20.0)
    changing = Film(1, ALIGNED, FRAMES, HZ, Store(PLENTY), world=world)
    before_s = world.changes(60.0)[0].begins_s - 0.01
    assert all(
        changing.measure(2, EVERYTHING, before_s)[part].tobytes() == film().measure(2, {part})[part].tobytes()
        for part in Part
    )
    later = changing.measure(2, EVERYTHING, 300.0)
    assert all(later[part].tobytes() != film().measure(2, {part})[part].tobytes() for part in Part)
    seen = expose(
        render(world.scene(300.0), pose_of(changing, 2), COLOR).color, Sensor(), np.random.default_rng((1, 2))
    )
    assert np.mean(np.abs(seen.astype(int) - later[Part.COLOR]) > 2) < 0.01
    assert changing.store.size == 0, "no instant comes twice"


def test_only_what_is_asked_for_is_measured() -> None:
    fresh = Film(1, ALIGNED, FRAMES, HZ, Store(PLENTY))
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


def driving(hz: float, frames: int = 120) -> Film:
    """Return a film of a camera in which a pixel is small."""
    return Film(1, Equipment(Camera.with_field_of_view(320, 240, 1.2)), frames, hz, Store(0))


def sharpness(picture: Array) -> float:
    """Return how much neighbours in a row differ."""
    return float(np.abs(np.diff(picture.astype(int), axis=1)).mean())


@pytest.mark.parametrize("number", [0, 17])
def test_colour_is_smeared_by_how_the_robot_moves_for_eight_milliseconds(number: int) -> None:
    scene, moving = generate(1), driving(hz=2)
    drive, camera = Drive.plan(scene), moving.equipment.color
    opened, now, closed = (drive.pose((number + 2 * seconds) / 120) for seconds in (-0.004, 0.0, 0.004))
    seen = smeared(render(scene, now, camera), camera, opened, closed)
    expected = expose(seen, Sensor(), np.random.default_rng((1, number)))
    picture = moving.measure(number, {Part.COLOR})[Part.COLOR]
    assert np.mean(np.abs(expected.astype(int) - picture) > 2) < 0.01
    assert picture.tobytes() == driving(hz=2).measure(number, {Part.COLOR})[Part.COLOR].tobytes()


def test_the_faster_a_robot_drives_the_more_is_smeared_and_depth_never_is() -> None:
    standing, slow, middling, fast = (driving(hz).measure(17, {Part.COLOR, Part.DEPTH}) for hz in (0, 0.01, 1, 2))
    assert standing[Part.COLOR].tobytes() == slow[Part.COLOR].tobytes()
    sharp = [sharpness(each[Part.COLOR]) for each in (slow, middling, fast)]
    assert sharp[2] < 0.98 * sharp[1] < 0.95 * sharp[0]
    assert len({each[Part.DEPTH].tobytes() for each in (standing, slow, middling, fast)}) == 1


def test_a_round_of_as_many_seconds_is_as_fast_however_many_instants_it_has() -> None:
    few, many = driving(hz=1, frames=60), driving(hz=2, frames=120)
    assert sharpness(few.measure(17, {Part.COLOR})[Part.COLOR]) == pytest.approx(
        sharpness(many.measure(34, {Part.COLOR})[Part.COLOR]), rel=0.02
    )


def test_the_robot_of_a_single_instant_stands() -> None:
    standing, moving = driving(hz=2, frames=1), driving(hz=0)
    expected = moving.measure(0, {Part.COLOR})[Part.COLOR]
    assert standing.measure(0, {Part.COLOR})[Part.COLOR].tobytes() == expected.tobytes()
