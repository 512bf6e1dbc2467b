from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from services.simulator.world import (
    Camera,
    ChangeKind,
    ChangingWorld,
    Drive,
    Lidar,
    Pose,
    Scene,
    Travel,
    generate,
    present_in,
    render,
    truth,
    turn,
)
from services.simulator.world.clearance import Clearance
from services.simulator.world.cuboids import Frame
from services.simulator.world.scene import Places, arranged, arranged_cuboids, rows_of

SEED = 3
SECONDS = 150.0
CAMERA = Camera.with_field_of_view(160, 120, 1.2)


@pytest.fixture(scope="module")
def travels() -> list[Travel]:
    scene = generate(SEED)
    return [Travel(drive, drive.length) for drive in (Drive.plan(scene, number) for number in range(2))]


@pytest.fixture(scope="module")
def world(travels: list[Travel]) -> ChangingWorld:
    return ChangingWorld(generate(SEED), 8.0, travels)


def test_until_something_changes_the_scene_is_the_still_one(world: ChangingWorld) -> None:
    (first, *_) = world.changes(SECONDS)
    assert world.scene(0.0) is world.still
    assert world.scene(first.begins_s - 0.01) is world.still
    assert world.scene(first.ends_s + 0.01) is not world.still


def test_nothing_looks_different_where_nothing_is_elsewhere() -> None:
    scene = generate(SEED)
    pose = Drive.plan(scene).pose(0.3)
    same = arranged(scene, {0: scene.movables[0].frame})
    one, other = render(scene, pose, CAMERA), render(same, pose, CAMERA)
    assert np.array_equal(one.instances, other.instances)
    assert np.abs(one.color.astype(int) - other.color).max() <= 1
    assert arranged(scene, {}) is scene


def test_the_same_arguments_make_the_same_changes_in_whatever_order_they_are_asked_for(
    world: ChangingWorld, travels: list[Travel]
) -> None:
    again = ChangingWorld(generate(SEED), 8.0, travels)
    late = again.scene(SECONDS)
    assert [(each.kind, each.movable, each.begins_s) for each in again.changes(SECONDS)] == [
        (each.kind, each.movable, each.begins_s) for each in world.changes(SECONDS)
    ]
    for second in (20.0, SECONDS):
        assert again.places(second) == world.places(second)
    assert np.array_equal(late.cuboids.corners(), world.scene(SECONDS).cuboids.corners())


def test_every_kind_of_change_comes_and_they_come_one_after_the_other(world: ChangingWorld) -> None:
    changes = world.changes(600.0)
    assert set(Counter(each.kind for each in changes)) == set(ChangeKind)
    for one, other in pairwise(changes):
        assert one.begins_s <= one.ends_s <= other.begins_s
    for each in changes:
        name = world.still.movables[each.movable].name
        assert (name == "forklift") == (each.kind is ChangeKind.DRIVEN)
        assert (each.motion is None) == (each.kind is ChangeKind.TAKEN)
    assert [each.begins_s for each in world.changes(60.0)] == [each.begins_s for each in changes if each.begins_s <= 60]


def test_nothing_hits_anything_nor_a_robot(world: ChangingWorld, travels: list[Travel]) -> None:
    scene = world.still
    for change in world.changes(SECONDS):
        if change.motion is None:
            continue
        places = world.places(change.begins_s)
        others = Clearance.of(_with(scene, places | {change.movable: None}))
        for second in np.linspace(change.begins_s, change.ends_s, 20).tolist():
            place = change.place(second)
            assert place is not None
            corners = _corners(scene, change.movable, place)
            assert others.at(corners).min() > 0
            for travel in travels:
                away = np.hypot(*(corners - travel.place(second)).T).min()
                assert away > 0.3


def test_the_truth_of_an_instant_is_what_is_rendered_then(world: ChangingWorld) -> None:
    checked: Counter[ChangeKind] = Counter()
    for change in world.changes(300.0):
        second = (change.begins_s + change.ends_s) / 2
        scene = world.scene(second)
        objects = {each.instance: each for each in world.objects(second)}
        own = scene.movables[change.movable].instances
        place = change.place(second)
        if place is None:
            assert not set(own) & objects.keys()
            assert not set(own) & set(scene.cuboids.instances.tolist())
            checked[change.kind] += 1
            continue
        assert set(own) <= objects.keys()
        for seen in truth(scene, _looking_at(place), CAMERA, least_pixels=30):
            if seen.instance in own:
                box = objects[seen.instance].box
                assert box.centre == pytest.approx(seen.box.centre)
                assert box.clipped(seen.centroid_in_map[np.newaxis]) == pytest.approx(
                    seen.centroid_in_map[np.newaxis], abs=0.05
                )
                checked[change.kind] += 1
    assert checked.keys() == set(ChangeKind)


def test_an_object_keeps_its_shape_its_load_and_its_number_wherever_it_is(world: ChangingWorld) -> None:
    scene = world.still
    home = {each.instance: each.box for each in present_in(scene)}
    moved = next(each for each in world.changes(SECONDS) if each.motion is not None)
    number, own = moved.movable, scene.movables[moved.movable]
    place = Frame(own.frame.x + 1.0, own.frame.y - 2.0, 0.0, own.frame.yaw + np.pi / 2)
    there = {each.instance: each.box for each in present_in(arranged(scene, {number: place}))}
    for instance, box in there.items():
        assert box.size == pytest.approx(home[instance].size, abs=1e-4)
        x, y, z = home[instance].centre - [own.frame.x, own.frame.y, 0]
        expected = [place.x - y, place.y + x, z] if instance in own.instances else home[instance].centre
        assert box.centre == pytest.approx(expected, abs=1e-4)


def test_lidars_and_the_floor_see_what_is_away(world: ChangingWorld) -> None:
    scene = world.still
    number = next(number for number, each in enumerate(scene.movables) if each.name == "pallet")
    place, away = scene.movables[number].frame, arranged(scene, {number: None})
    pose = Pose.upright(place.x - 2.0, place.y, 0.2, 0.0)
    for each, there in ((scene, True), (away, False)):
        hit = set(turn(each, pose, Lidar(), np.random.default_rng(0)).instances.tolist())
        assert bool(hit & set(scene.movables[number].instances)) == there
    brighter = away.floor.image.astype(int) - scene.floor.image
    assert brighter.min() >= 0
    assert brighter.max() > 10


def test_goods_on_racks_stay_and_what_is_carried_belongs_to_what_carries_it() -> None:
    scene = generate(SEED)
    for movable in scene.movables:
        assert scene.class_name(movable.instances.start) == movable.name
        assert len(rows_of(scene, movable)) > 0
        low = scene.cuboids.taken(rows_of(scene, movable)).corners()[..., 2].min()
        assert low == pytest.approx(0.0, abs=0.02)
    belongs = [instance for movable in scene.movables for instance in movable.instances]
    assert len(belongs) == len(set(belongs)) < len(scene.instance_classes) - 1


def _with(scene: Scene, places: Places) -> Scene:
    return replace(scene, cuboids=arranged_cuboids(scene, places))


def _corners(scene: Scene, number: int, place: Frame) -> NDArray[np.float64]:
    """Return the corners on the map of the parts of a movable that stand in a robot's way, (n, 2)."""
    moved = arranged_cuboids(scene, {number: place})
    own = scene.movables[number].instances
    rows = np.flatnonzero(np.isin(moved.instances, list(own)))
    corners = moved.taken(rows).corners().reshape(-1, 3)
    return np.asarray(corners[corners[:, 2] < 1.5, :2], np.float64)


def _looking_at(place: Frame) -> Pose:
    return Pose.looking(place.x - 2.5, place.y, 1.5, yaw=0.0, pitch=-0.4)


def test_a_world_in_which_nothing_can_change_stays_as_it_is() -> None:
    scene = replace(generate(SEED), movables=())
    world = ChangingWorld(scene, 60.0)
    assert world.changes(1_000.0) == []
    assert world.scene(2_000.0) is scene
