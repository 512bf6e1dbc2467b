from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from services.simulator.world import Camera, Drive, Pose, Scene, SeenObject, generate, render, truth, truth_of
from services.simulator.world.truth import parts_of
from tests.services.simulator.world.rays import cast, pixel_rays

SEED = 704
FLOOR = 0
CAMERA = Camera(320, 240, 232.8, 232.8, 159.5, 119.5)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return generate(SEED)


@pytest.fixture(scope="module")
def poses(scene: Scene) -> list[Pose]:
    drive = Drive.plan(scene)
    return [drive.pose(index / 5) for index in range(5)]


@pytest.fixture(scope="module")
def views(scene: Scene, poses: list[Pose]) -> list[tuple[SeenObject, ...]]:
    return [truth(scene, pose, CAMERA) for pose in poses]


def test_the_masks_are_the_rendering_s_instances(
    scene: Scene, poses: list[Pose], views: list[tuple[SeenObject, ...]]
) -> None:
    for pose, seen in zip(poses, views, strict=True):
        instances = render(scene, pose, CAMERA).instances
        drawn = np.zeros_like(instances)
        for each in seen:
            drawn[each.full_mask()] += each.instance
            assert each.mask[0].any()
            assert each.mask[-1].any()
            assert each.mask[:, 0].any()
            assert each.mask[:, -1].any()
            assert each.name == scene.class_name(each.instance)
        assert np.array_equal(drawn, instances)
        assert sum(each.image_share for each in seen) == pytest.approx(np.mean(instances > 0))


def test_small_ones_are_left_out_on_demand(scene: Scene, poses: list[Pose]) -> None:
    pose = poses[4]
    geometry = render(scene, pose, CAMERA)
    everything = truth_of(scene, geometry, pose, CAMERA)
    sizes = sorted(each.pixels for each in everything)
    large = truth_of(scene, geometry, pose, CAMERA, least_pixels=sizes[3])
    assert [each.instance for each in large] == [each.instance for each in everything if each.pixels >= sizes[3]]
    assert truth_of(scene, geometry, pose, CAMERA, least_pixels=sizes[-1] + 1) == ()


def test_visibility_is_what_rays_say(scene: Scene, views: list[tuple[SeenObject, ...]]) -> None:
    errors = []
    for each in views[3]:
        low, high = outline(each)
        if each.pixels >= 150 and np.prod(high - low) < 2500:
            errors.append(each.visibility - visibility_by_rays(scene, each))
    assert len(errors) > 12
    assert np.mean(np.abs(errors)) < 0.03
    assert np.abs(errors).max() < 0.08  # nearer objects' outlines take a pixel of what is behind them


def outline(each: SeenObject) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the least and the greatest column and row of an object before the camera; (0, 0) to (99, 99) else."""
    corners = each.box.seen_from(each.view.pose).corners()
    if corners[:, 2].min() < 0.1:
        return np.array([0, 0]), np.array([99, 99])
    pixels = corners[:, :2] / corners[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy)
    return np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int)


def visibility_by_rays(scene: Scene, each: SeenObject) -> float:
    (left, top), (right, bottom) = outline(each)
    grid = np.meshgrid(np.arange(left, right + 1), np.arange(top, bottom + 1))
    columns, rows = (axis.ravel().astype(np.float64) for axis in grid)
    origin, rays = each.view.pose.position.astype(np.float64), pixel_rays(columns, rows, each.view.pose, CAMERA)
    covers = cast(parts_of(scene, each.instance), origin, rays)[1] >= 0
    inside = (columns >= 0) & (columns < CAMERA.width) & (rows >= 0) & (rows < CAMERA.height)
    first = cast(scene.cuboids, origin, rays[covers & inside])[1]
    return float(np.sum(scene.cuboids.instances[first] == each.instance) / covers.sum())


def test_what_stands_free_and_wholly_in_view_is_all_visible(scene: Scene) -> None:
    free = 0
    for instance in range(1, len(scene.instance_classes)):
        own = np.flatnonzero(scene.cuboids.instances == instance)
        alone = replace(scene, cuboids=scene.cuboids.taken(np.append(FLOOR, own)))
        x, y, _ = scene.instance_centres()[instance]
        bearing = 0.7 * instance
        spot = (x - 6 * np.cos(bearing), y - 6 * np.sin(bearing))
        pose = Pose.looking(float(spot[0]), float(spot[1]), 1.4, bearing, -0.1)
        seen = {each.instance: each for each in truth(alone, pose, CAMERA)}
        each = seen.get(instance)
        if each is not None and not touches_border(each):
            assert each.visibility == 1
            free += 1
    assert free > 30


def touches_border(each: SeenObject) -> bool:
    mask = each.full_mask()
    return bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())


def test_boxes_contain_what_is_seen(views: list[tuple[SeenObject, ...]]) -> None:
    for seen in views:
        for each in seen:
            box = each.box.seen_from(each.view.pose)
            corners = box.corners()
            if corners[:, 2].min() < 0.1:
                continue
            pixels = corners[:, :2] / corners[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy)
            rows, columns = np.nonzero(each.full_mask())
            assert pixels[:, 0].min() - 1 <= columns.min()
            assert columns.max() <= pixels[:, 0].max() + 1
            assert pixels[:, 1].min() - 1 <= rows.min()
            assert rows.max() <= pixels[:, 1].max() + 1


def test_the_visible_box_is_inside_the_whole_one(views: list[tuple[SeenObject, ...]]) -> None:
    for each in (each for seen in views for each in seen):
        assert (each.visible_box.size <= each.box.size + 1e-6).all()
        corners = each.visible_box.corners()
        assert each.box.clipped(corners) == pytest.approx(corners, abs=1e-5)


def test_distances_and_centroids_are_those_of_the_points(views: list[tuple[SeenObject, ...]]) -> None:
    for each in (each for seen in views for each in seen):
        assert len(each.points) == each.pixels
        assert each.points[:, 2].min() <= each.depth_m <= each.distance_m
        assert each.centroid == pytest.approx(each.points.mean(axis=0))
        slack = 0.05 * each.distance_m
        assert each.box.clipped(each.centroid_in_map[None])[0] == pytest.approx(each.centroid_in_map, abs=slack)


def test_depth_is_where_rays_meet_the_objects(scene: Scene, poses: list[Pose]) -> None:
    pose = poses[2]
    rng = np.random.default_rng(1)
    rows, columns = rng.integers(0, CAMERA.height, 3000), rng.integers(0, CAMERA.width, 3000)
    rays = pixel_rays(columns.astype(np.float64), rows.astype(np.float64), pose, CAMERA)
    first, hit = cast(scene.cuboids, pose.position.astype(np.float64), rays)
    geometry = render(scene, pose, CAMERA)
    assert np.mean(geometry.instances[rows, columns] == scene.cuboids.instances[hit]) > 0.98
    assert np.mean(np.abs(geometry.depth[rows, columns] / first - 1) < 1e-3) > 0.97


def test_objects_keep_their_number_in_every_view(views: list[tuple[SeenObject, ...]]) -> None:
    boxes: dict[int, SeenObject] = {}
    again = 0
    for each in (each for seen in views for each in seen):
        known = boxes.setdefault(each.instance, each)
        again += known is not each
        assert known.name == each.name
        assert known.box.centre == pytest.approx(each.box.centre)
    assert again > 0


def test_from_where_nothing_is_to_be_seen(scene: Scene) -> None:
    assert truth(scene, Pose.looking(100, 0, 1, 0), CAMERA) == ()
