import numpy as np
import pytest

from services.simulator.world import CLASSES, Scene, generate
from services.simulator.world.cuboids import Material


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return [generate(seed) for seed in range(12)]


def test_the_same_seed_gives_the_same_scene() -> None:
    one, other = generate(5), generate(5)
    for name in ("centres", "rotations", "half_extents", "colours", "materials", "variants", "instances"):
        assert np.array_equal(getattr(one.cuboids, name), getattr(other.cuboids, name)), name
    assert np.array_equal(one.floor.image, other.floor.image)
    assert np.array_equal(one.surfaces.light, other.surfaces.light)


def test_another_seed_gives_another_scene() -> None:
    assert generate(5).half_x != generate(6).half_x


def test_every_cuboid_belongs_to_a_known_instance(scenes: list[Scene]) -> None:
    for scene in scenes:
        assert scene.instance_classes[0] == -1
        assert set(scene.instance_classes[1:]) <= set(range(len(CLASSES)))
        assert np.array_equal(np.unique(scene.cuboids.instances), np.arange(len(scene.instance_classes)))


def test_every_scene_has_every_class(scenes: list[Scene]) -> None:
    assert CLASSES == ("box", "pallet", "forklift")
    for scene in scenes:
        assert {scene.class_name(i) for i in range(1, len(scene.instance_classes))} == set(CLASSES)


def test_the_background_has_no_class(scenes: list[Scene]) -> None:
    with pytest.raises(ValueError, match="no class"):
        scenes[0].class_name(0)


def test_cardboard_is_boxes_and_wood_is_pallets(scenes: list[Scene]) -> None:
    for scene in scenes:
        classes = scene.instance_classes[scene.cuboids.instances]
        assert (classes[scene.cuboids.materials == Material.CARDBOARD] == CLASSES.index("box")).all()
        assert (classes[scene.cuboids.materials == Material.WOOD] == CLASSES.index("pallet")).all()


def test_objects_are_inside_the_hall_and_not_below_its_floor(scenes: list[Scene]) -> None:
    for scene in scenes:
        corners = scene.cuboids.corners()[scene.cuboids.instances > 0].reshape(-1, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        assert low[2] > -0.05
        assert high[2] < 6
        assert (high[:2] < (scene.half_x + 0.5, scene.half_y + 0.5)).all()
        assert (low[:2] > (-scene.half_x - 0.5, -scene.half_y - 0.5)).all()


def test_instance_centres_are_those_of_bounding_boxes(scenes: list[Scene]) -> None:
    scene = scenes[0]
    corners = scene.cuboids.corners()[scene.cuboids.instances == 3].reshape(-1, 3)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    assert scene.instance_centres()[3] == pytest.approx(middle)
    assert np.isnan(scene.instance_centres()[0]).all()
