import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.cloud.upright_boxes import Boxes, Level
from tests.services.cloud.boxes import each, fit_box

RNG = np.random.default_rng(5)
Z_UP = Level.of(np.array([0.0, 0.0, 1.0]))
Y_DOWN = Level.of(np.array([0.0, -1.0, 0.0]))


def cuboid(
    size: tuple[float, float, float],
    yaw: float,
    centre: tuple[float, float, float],
    *,
    sides: tuple[int, ...] = (0, 1, 2),
    noise: float = 0.0,
) -> NDArray[np.float32]:
    """Return points on the faces of a box in a frame with z up: on its high side along each axis that is named."""
    faces = []
    for side in sides:
        face = RNG.uniform(-0.5, 0.5, (1500, 3)) * size
        face[:, side] = size[side] / 2
        faces.append(face)
    points = np.concatenate(faces) + noise * RNG.standard_normal((1500 * len(sides), 3))
    cos, sin = math.cos(yaw), math.sin(yaw)
    turned = points @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).T + centre
    return np.asarray(turned.T, np.float32)


def apart(yaw: float, other: float) -> float:
    """Return how far two lines are turned from each other."""
    return abs((yaw - other + math.pi / 2) % math.pi - math.pi / 2)


@settings(max_examples=30, deadline=None)
@given(
    st.floats(-1.5, 1.5),
    st.tuples(st.floats(0.8, 3), st.floats(0.2, 0.6), st.floats(0.1, 2)),
    st.sampled_from([(0, 1), (0, 1, 2), (0, 2), (1, 2)]),
)
def test_the_box_of_the_sides_that_are_seen_is_that_of_the_whole(
    yaw: float, size: tuple[float, float, float], sides: tuple[int, ...]
) -> None:
    box = fit_box(cuboid(size, yaw, (2, -1, 0.5), sides=sides), Z_UP)
    if 2 in sides or sides == (0, 1):
        assert apart(box.yaw, yaw) < math.radians(2)
        assert box.size[:2] == pytest.approx(size[:2], rel=0.06, abs=0.03)
    assert box.centre[:2] == pytest.approx([2, -1], abs=0.06)


def test_an_l_is_turned_as_its_sides_are() -> None:
    for yaw in np.linspace(-1.5, 1.5, 13):
        box = fit_box(cuboid((1.0, 0.7, 0.5), yaw, (0, 0, 0), sides=(0, 1), noise=0.005), Z_UP)
        assert apart(box.yaw, yaw) < math.radians(3)


def test_one_side_is_a_thin_box() -> None:
    box = fit_box(cuboid((0.6, 0.4, 0.3), 0.3, (1, 1, 1), sides=(1,)), Z_UP)
    assert box.size == pytest.approx([0.6, 0.0, 0.3], abs=0.02)
    assert box.yaw == pytest.approx(0.3, abs=0.03)


def test_in_an_optical_frame_a_box_stands_on_the_ground_too() -> None:
    points = cuboid((1.2, 0.8, 0.4), 0.5, (4, 0, 0))
    optical = np.stack([-points[1], -points[2], points[0]])  # x right, y down, z forward
    box = fit_box(optical, Y_DOWN)
    assert box.size == pytest.approx([1.2, 0.8, 0.4], rel=0.03)
    # From a view's right to its left by way of ahead is 0.5 more than from its front to its left.
    assert apart(box.yaw, 0.5 + math.pi / 2) < math.radians(2)


def test_the_length_is_the_longer_level_side() -> None:
    box = fit_box(cuboid((0.4, 1.2, 2.0), 0.0, (0, 0, 0)), Z_UP)
    assert box.size == pytest.approx([1.2, 0.4, 2.0], rel=0.03)
    assert abs(box.yaw) == pytest.approx(math.pi / 2, abs=0.03)


@pytest.mark.parametrize("count", [1, 2, 10])
def test_points_in_one_place_are_a_box_without_size(count: int) -> None:
    box = fit_box(np.full((3, count), 2, np.float32), Z_UP)
    assert box.size == pytest.approx([0, 0, 0])
    assert box.centre == pytest.approx([2, 2, 2])


def test_a_few_stray_points_make_no_box_larger() -> None:
    points = cuboid((1.0, 0.5, 0.5), 0.2, (0, 0, 0))
    strays = np.array([[0, 0.1, 0], [0, 0, 0.1], [9, 8, 9]], np.float32)
    box = fit_box(np.concatenate([points, strays], axis=1), Z_UP)
    assert box.size == pytest.approx([1.0, 0.5, 0.5], rel=0.03)


def test_level_axes_are_level_and_right_handed_whatever_is_up() -> None:
    for up in (*np.eye(3), *-np.eye(3), np.array([0.6, 0.0, 0.8])):
        level = Level.of(up)
        axes = np.stack([level.x, level.y, level.up])
        assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1)


def test_yaw_is_counter_clockwise_from_x_and_a_line_has_no_direction() -> None:
    along = np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [0.0, 1.0, 0.0], [1.0, -1.0, 0.0]])
    assert Z_UP.yaws(along) == pytest.approx(np.array([1, 1, 2, -1]) * math.pi / 4)


def test_boxes_go_from_place_to_place_along_their_sides() -> None:
    low, high = np.array([[0.0, 0, 0], [1, -1, 0]]), np.array([[2.0, 1, 3], [2, 3, 4]])
    first, second = each(Boxes.between(low, high, np.array([math.pi / 2, 0.0]), Z_UP), Z_UP)
    assert first.centre == pytest.approx([-0.5, 1, 1.5])
    assert second.centre == pytest.approx([1.5, 1, 2])
    assert (first.size.tolist(), second.size.tolist()) == ([2, 1, 3], [4, 1, 4])
    assert [first.yaw, second.yaw] == pytest.approx([math.pi / 2] * 2)
