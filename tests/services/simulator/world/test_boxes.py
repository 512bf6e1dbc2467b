import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.world import Box, Pose, generate
from services.simulator.world.cuboids import Builder, Frame, Material, Paint
from services.simulator.world.truth import box_of, parts_of

WOOD = Paint(Material.WOOD, (1, 1, 1))
angles = st.floats(-3.1, 3.1)
places = st.floats(-20, 20)


@given(places, places, angles)
def test_one_cuboid_is_its_own_box(x: float, y: float, yaw: float) -> None:
    builder = Builder()
    builder.object(Frame(x, y, 1.0, yaw), "box").cuboid((0, 0, 0.5), (0.3, 0.2, 0.5), WOOD)
    box = box_of(builder.cuboids())
    assert box.centre == pytest.approx([x, y, 1.5], abs=1e-4)
    assert box.size == pytest.approx([0.6, 0.4, 1.0], abs=1e-4)
    assert np.cos(box.yaw - yaw) == pytest.approx(1)
    assert box.corners() == pytest.approx(builder.cuboids().corners()[0], abs=1e-4)


@given(angles, angles, st.floats(-1.2, 1.2))
def test_a_box_seen_from_a_camera_is_the_same_box(yaw: float, heading: float, pitch: float) -> None:
    box = Box(np.array([3.0, -1.0, 0.7]), np.array([1.2, 0.8, 0.144]), yaw, np.array([0.0, 0.0, 1.0]))
    pose = Pose.looking(1.0, 2.0, 0.9, heading, pitch)
    seen = box.seen_from(pose)
    assert pose.to_map(seen.corners()) == pytest.approx(box.corners(), abs=1e-5)
    assert seen.up == pytest.approx([0, -np.cos(pitch), np.sin(pitch)], abs=1e-6)


def test_a_level_camera_measures_yaw_from_its_right() -> None:
    box = Box(np.array([3.0, 0.0, 0.0]), np.ones(3), 0.25, np.array([0.0, 0.0, 1.0]))
    seen = box.seen_from(Pose.looking(0, 0, 0, 0))
    assert seen.yaw == pytest.approx(0.25 + np.pi / 2)
    assert seen.centre == pytest.approx([0, 0, 3])


def test_a_box_of_many_parts_goes_around_all_of_them() -> None:
    scene = generate(704)
    for instance in range(1, len(scene.instance_classes)):
        parts = parts_of(scene, instance)
        box = box_of(parts)
        corners = parts.corners().reshape(-1, 3).astype(np.float64)
        assert box.clipped(corners) == pytest.approx(corners, abs=1e-4)
        local = np.abs((corners - box.centre) @ box.axes)
        assert local.max(axis=0) == pytest.approx(box.size / 2, abs=1e-4)


def test_points_outside_are_moved_to_the_surface() -> None:
    box = Box(np.zeros(3), np.array([2.0, 1.0, 1.0]), np.pi / 2, np.array([0.0, 0.0, 1.0]))
    moved = box.clipped(np.array([[0.0, 3.0, 0.2], [0.1, 0.2, -0.3]]))
    assert moved == pytest.approx(np.array([[0, 1, 0.2], [0.1, 0.2, -0.3]]))
