import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.simulator.world import Camera, DepthSensor, Drive, as_16uc1, as_32fc1, generate, render_geometry, sense

CAMERA = Camera(160, 120, 116.4, 116.4, 79.5, 59.5)
WIDE = Camera()
SENSOR = DepthSensor()


def wall(metres: float, camera: Camera = CAMERA) -> NDArray[np.float32]:
    return np.full((camera.height, camera.width), metres, np.float32)


def measured(depth: NDArray[np.float32], camera: Camera = CAMERA, sensor: DepthSensor = SENSOR) -> NDArray[np.float32]:
    return sense(depth, camera, sensor, np.random.default_rng(1))


@pytest.mark.parametrize("metres", [0.5, 1.0, 2.0, 4.0])
def test_noise_grows_with_the_square_of_depth(metres: float) -> None:
    error = measured(wall(metres, WIDE), WIDE) - metres
    expected = metres**2 * SENSOR.subpixel / (SENSOR.baseline * WIDE.fx)
    assert error.std() == pytest.approx(expected, rel=0.1)
    assert error.mean() == pytest.approx(0, abs=expected / 5)


@settings(max_examples=30)
@given(st.floats(0.0, 20.0))
def test_beyond_its_limits_there_is_no_depth(metres: float) -> None:
    sensor = DepthSensor(subpixel=0.0, steps=4096)
    depth = measured(wall(metres), sensor=sensor)
    if 0.285 < metres < 9.8:
        assert np.allclose(depth, metres, rtol=2e-2)
    elif metres < 0.275 or metres > 10.2:
        assert not depth.any()


def test_depth_comes_in_steps_of_disparity_and_millimetres() -> None:
    ramp = np.tile(np.linspace(3, 3.4, CAMERA.width, dtype=np.float32), (CAMERA.height, 1))
    depth = measured(ramp, sensor=DepthSensor(subpixel=0.0))
    values = np.unique(depth[depth > 0])
    assert (np.rint(values * 1000) / 1000).astype(np.float32) == pytest.approx(values)
    steps = SENSOR.baseline * CAMERA.fx / values.astype(np.float64) * SENSOR.steps
    assert steps == pytest.approx(np.rint(steps), abs=0.05)
    assert len(values) < 12


def test_to_the_left_of_something_near_is_its_shadow() -> None:
    depth = wall(4.0, WIDE)
    depth[:, 300:340] = 1.0
    seen = measured(depth, WIDE, DepthSensor(subpixel=0.0, edge=1e9)) > 0
    width = SENSOR.baseline * WIDE.fx * (1 / 1.0 - 1 / 4.0)
    assert (~seen[100]).sum() == pytest.approx(width, abs=1)
    assert not seen[:, 300 - int(width) : 300].any()
    assert seen[:, :280].all()
    assert seen[:, 300:].all()


def test_at_edges_pixels_are_lost_or_in_between() -> None:
    depth = wall(2.0, WIDE)
    depth[240:] = 1.0
    seen = measured(depth, WIDE, DepthSensor(subpixel=0.0))
    at_edge = seen[239:241]
    assert np.mean(at_edge == 0) == pytest.approx(SENSOR.lost, abs=0.1)
    assert ((at_edge == 0) | ((at_edge > 0.99) & (at_edge < 2.01))).all()
    assert ((at_edge > 1.1) & (at_edge < 1.9)).any()
    assert np.allclose(seen[:239], 2.0, rtol=0.01)
    assert np.allclose(seen[241:], 1.0, rtol=0.01)


@pytest.mark.parametrize(("angle", "least", "most"), [(1.3, 0.0, 0.0), (1.46, 0.3, 0.8), (1.555, 1.0, 1.0)])
def test_surfaces_seen_at_a_grazing_angle_have_holes(angle: float, least: float, most: float) -> None:
    """A plane 2 m ahead, turned so that the optical axis meets it at `angle` from its normal."""
    narrow = Camera(160, 120, 4000.0, 4000.0, 79.5, 59.5)
    rows = (np.arange(120) - narrow.cy) / narrow.fy
    depth = np.tile((2.0 / (1 + np.tan(angle) * rows)).astype(np.float32)[:, None], (1, 160))
    holes = np.mean(measured(depth, narrow, DepthSensor(subpixel=0.0, edge=1e9, baseline=0.005)) == 0)
    assert least <= holes <= most


def test_what_a_robot_sees_keeps_most_of_its_depth_and_is_right_about_it() -> None:
    scene = generate(704)
    geometry = render_geometry(scene, Drive.plan(scene).pose(3 / 8), CAMERA)
    depth = measured(geometry.depth)
    near = (geometry.depth < 4) & (depth > 0)
    assert np.mean(depth > 0) > 0.4
    assert np.median(np.abs(depth[near] / geometry.depth[near] - 1)) < 0.03


@settings(max_examples=5)
@given(st.integers(0, 2**32))
def test_the_same_seed_gives_the_same_noise(seed: int) -> None:
    one, same = (sense(wall(2.0), CAMERA, SENSOR, np.random.default_rng(seed)) for _ in range(2))
    assert np.array_equal(one, same)


def test_an_image_of_one_pixel() -> None:
    assert measured(wall(2.0, Camera(1, 1)), Camera(1, 1)).shape == (1, 1)


def test_ros_s_two_ways_to_write_it() -> None:
    depth = np.array([[0.0, 1.234], [65.535, 65.6]], np.float32)
    assert as_16uc1(depth).tolist() == [[0, 1234], [65535, 0]]
    assert as_16uc1(depth).dtype == np.uint16
    metres = as_32fc1(depth)
    assert metres.dtype == np.float32
    assert np.isnan(metres[0, 0])
    assert metres[0, 1] == pytest.approx(1.234)
