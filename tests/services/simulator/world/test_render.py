import numpy as np
import pytest

from services.simulator.world import CLASSES, Camera, Drive, Pose, Rendering, Scene, generate, render, render_geometry
from services.simulator.world.render import FLOOR_TOP
from services.simulator.world.shading import Shader
from services.simulator.world.textures import atlas
from services.simulator.world.visibility import find_visible

SEED = 704


@pytest.fixture(scope="module")
def scene() -> Scene:
    return generate(SEED)


@pytest.fixture(scope="module")
def drive(scene: Scene) -> Drive:
    return Drive.plan(scene)


@pytest.fixture(scope="module")
def views(scene: Scene, drive: Drive) -> list[Rendering]:
    return [render(scene, drive.pose(index / 8), Camera()) for index in range(8)]


def test_shapes_and_types(views: list[Rendering]) -> None:
    for view in views:
        assert view.color.shape == (480, 640, 3)
        assert view.color.dtype == np.uint8
        assert view.depth.shape == (480, 640)
        assert view.depth.dtype == np.float32
        assert view.instances.shape == (480, 640)
        assert view.instances.dtype == np.int32


def test_the_same_again_from_the_seed_alone(views: list[Rendering]) -> None:
    scene = generate(SEED)
    again = render(scene, Drive.plan(scene).pose(3 / 8), Camera())
    assert np.array_equal(again.color, views[3].color)
    assert np.array_equal(again.depth, views[3].depth)
    assert np.array_equal(again.instances, views[3].instances)


def test_the_geometry_alone_is_the_same(scene: Scene, drive: Drive, views: list[Rendering]) -> None:
    alone = render_geometry(scene, drive.pose(3 / 8), Camera())
    assert np.array_equal(alone.depth, views[3].depth)
    assert np.array_equal(alone.instances, views[3].instances)


def test_depth_is_positive_wherever_an_object_is(views: list[Rendering]) -> None:
    for view in views:
        assert view.depth[view.instances > 0].min() > 0.05
        assert view.depth.max() < 40
        assert np.mean(view.depth == 0) < 1e-4


def test_instances_are_objects_of_the_scene(scene: Scene, views: list[Rendering]) -> None:
    seen = set(np.unique(np.concatenate([view.instances.ravel() for view in views]))) - {0}
    assert {scene.class_name(int(instance)) for instance in seen} == set(CLASSES)


def test_objects_are_where_their_pixels_and_depth_say(scene: Scene, drive: Drive, views: list[Rendering]) -> None:
    camera, pose = Camera(), drive.pose(2 / 8)
    view = views[2]
    rows, columns = np.nonzero(view.instances > 0)
    depth = view.depth[rows, columns]
    rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones_like(depth)], axis=1)
    points = (rays * depth[:, None]) @ pose.rotation.T + pose.position
    corners = scene.cuboids.corners()
    for instance in np.unique(view.instances[rows, columns]):
        own = corners[scene.cuboids.instances == instance].reshape(-1, 3)
        seen = points[view.instances[rows, columns] == instance]
        slack = 0.02 + 0.01 * depth[view.instances[rows, columns] == instance].max()
        assert (seen >= own.min(axis=0) - slack).mean() > 0.99
        assert (seen <= own.max(axis=0) + slack).mean() > 0.99


def test_bands_may_be_shaded_in_any_order(scene: Scene, drive: Drive, views: list[Rendering]) -> None:
    camera, pose = Camera(), drive.pose(1 / 8)
    shader = Shader(
        surfaces=scene.surfaces,
        floor=scene.floor,
        floor_face=FLOOR_TOP,
        atlas=atlas(),
        visible=find_visible(scene.cuboids, pose, camera),
        camera=camera,
        pose=pose,
    )
    image = np.zeros_like(views[1].color)
    for top in (400, 0, 37, 100):
        bottom = {400: 480, 0: 37, 37: 100, 100: 400}[top]
        image[top:bottom] = shader.band(top, bottom)
    assert np.array_equal(image, views[1].color)


def test_cameras_of_any_size(scene: Scene, drive: Drive) -> None:
    for width, height in ((1, 1), (16, 9), (130, 7)):
        view = render(scene, drive.pose(0), Camera.with_field_of_view(width, height, 1.2))
        assert view.color.shape == (height, width, 3)


def test_from_outside_the_hall_there_is_nothing_to_see(scene: Scene) -> None:
    view = render(scene, Pose.looking(100, 0, 1, 0), Camera(64, 48))
    assert not view.instances.any()
    assert not view.depth.any()
    assert np.ptp(view.color) == 0


def test_a_smaller_camera_sees_the_same_world(scene: Scene, drive: Drive, views: list[Rendering]) -> None:
    small = render(scene, drive.pose(0), Camera(width=320, height=240, fx=232.8, fy=232.8, cx=159.5, cy=119.5))
    assert np.mean(small.instances == views[0].instances[::2, ::2]) > 0.97
