import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.simulator.world import Camera, Lidar, Pose, Scene, generate, render_geometry, turn
from services.simulator.world.cuboids import Builder, Frame, Material, Paint
from services.simulator.world.lidar import cast
from tests.services.simulator.world import rays

GREY = Paint(Material.PLAIN, (0.5, 0.5, 0.5))
FEW = Lidar(elevations=(-0.2, -0.05, 0.0, 0.1), columns=90)
MIDDLE = Pose.upright(0, 0, 1.0, 0.3)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return generate(704)


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(0, 2), st.floats(-3, 3)), min_size=1, max_size=6),
    st.floats(-1.2, 1.2),
    st.floats(-3, 3),
)
def test_ranges_are_where_rays_meet_blocks(
    places: list[tuple[float, float, float, float]], pitch: float, yaw: float
) -> None:
    builder = Builder()
    for x, y, z, turned in places:
        builder.background(Frame(x, y, z, turned)).cuboid((0, 0, 0), (0.3, 0.7, 0.2), GREY, pitch=pitch)
    pose = Pose.upright(0, 0, 0.9, yaw)
    hits = cast(builder.cuboids(), pose, FEW)
    directions = FEW.directions().reshape(-1, 3) @ pose.rotation.T
    ranges, _ = rays.cast(builder.cuboids(), pose.position.astype(np.float64), directions)
    assert np.mean(np.isclose(hits.ranges.ravel(), ranges, rtol=1e-4)) > 0.98  # rays along an edge may go either way
    assert np.array_equal(hits.faces >= 0, np.isfinite(hits.ranges))


def test_a_tilted_lidar_sees_the_same_world(scene: Scene) -> None:
    level = Pose.upright(0.5, 0.5, 1.2, 0.4)
    cos, sin = np.cos(0.3), np.sin(0.3)
    tilt = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    pose = Pose(level.position, (level.rotation @ tilt).astype(np.float32))
    hits = cast(scene.cuboids, pose, FEW)
    directions = FEW.directions().reshape(-1, 3) @ pose.rotation.T
    ranges, _ = rays.cast(scene.cuboids, pose.position.astype(np.float64), directions)
    assert np.mean(np.isclose(hits.ranges.ravel(), ranges, rtol=1e-4)) > 0.99


def test_ranges_agree_with_the_depth_render_along_the_same_rays(scene: Scene) -> None:
    lidar = Lidar()
    hits = cast(scene.cuboids, MIDDLE, lidar)
    camera = Camera.with_field_of_view(640, 480, 1.2)
    geometry = render_geometry(scene, Pose.looking(0, 0, 1.0, 0.3), camera)
    x, y, z = np.moveaxis(lidar.directions(), -1, 0)
    with np.errstate(divide="ignore"):
        columns, rows = camera.cx - camera.fx * y / x, camera.cy - camera.fy * z / x
    seen = (x > 0.1) & (columns > 0) & (columns < 639) & (rows > 0) & (rows < 479)
    depth = geometry.depth[np.rint(rows[seen]).astype(int), np.rint(columns[seen]).astype(int)]
    error = np.abs(hits.ranges[seen] * x[seen] / depth - 1)
    assert seen.sum() > 4000
    assert np.median(error) < 2e-3
    assert np.mean(error < 0.02) > 0.95


def test_a_room_without_a_gap_answers_every_ray(scene: Scene) -> None:
    hits = cast(scene.cuboids, MIDDLE, Lidar.with_rings(9, -1.4, 1.4))
    assert np.isfinite(hits.ranges).all()
    assert (hits.faces >= 0).all()


def test_where_nothing_is_there_is_no_return(scene: Scene) -> None:
    outside = turn(scene, Pose.upright(100, 0, 1, 0), Lidar(greatest=50.0), np.random.default_rng(1))
    assert outside.xyz.shape == (0, 3)
    assert outside.ring.shape == (0,)
    assert np.isinf(cast(scene.cuboids.taken(np.arange(0)), MIDDLE, FEW).ranges).all()


def test_a_turn_reports_points_rings_and_what_they_are_on(scene: Scene) -> None:
    lidar = Lidar()
    one = turn(scene, MIDDLE, lidar, np.random.default_rng(1))
    assert one.xyz.dtype == np.float32
    assert one.ring.max() == 15
    elevation = np.arcsin(one.xyz[:, 2] / np.linalg.norm(one.xyz, axis=1))
    assert elevation == pytest.approx(np.asarray(lidar.elevations)[one.ring], abs=1e-4)
    assert len(np.unique(one.instances)) > 10
    assert (one.intensity >= 0).all()
    for instance in np.unique(one.instances[one.instances > 0]):
        on = MIDDLE.to_map(one.xyz[one.instances == instance].astype(np.float64))
        own = scene.cuboids.corners()[scene.cuboids.instances == instance].reshape(-1, 3)
        assert (on > own.min(axis=0) - 0.1).all()
        assert (on < own.max(axis=0) + 0.1).all()


def test_noise_and_limits_are_those_of_the_sensor(scene: Scene) -> None:
    lidar = Lidar(least=2.0, greatest=6.0, noise=0.02)
    exact = cast(scene.cuboids, MIDDLE, lidar).ranges
    measured = np.linalg.norm(turn(scene, MIDDLE, lidar, np.random.default_rng(1)).xyz, axis=1)
    assert measured.min() >= 1.9999
    assert measured.max() <= 6.0001
    assert len(measured) == pytest.approx(np.sum((exact > 2) & (exact < 6)), rel=0.01)
    exactly = turn(scene, MIDDLE, Lidar(noise=0.0), np.random.default_rng(1))
    noisy = turn(scene, MIDDLE, Lidar(noise=0.02), np.random.default_rng(1))
    difference = np.linalg.norm(noisy.xyz, axis=1) - np.linalg.norm(exactly.xyz, axis=1)
    assert difference.std() == pytest.approx(0.02, rel=0.05)


@settings(max_examples=5)
@given(st.integers(0, 1000))
def test_the_same_seed_gives_the_same_turn(seed: int) -> None:
    scene = generate(3)
    one, same = (turn(scene, MIDDLE, FEW, np.random.default_rng(seed)) for _ in range(2))
    assert np.array_equal(one.xyz, same.xyz)
    assert np.array_equal(one.intensity, same.intensity)
