import numpy as np
import pytest

from services.simulator.world.cuboids import BACKGROUND, CLASSES, Builder, Frame, Material, Paint

GREY = Paint(Material.PLAIN, (0.5, 0.5, 0.5))


def test_frames_nest() -> None:
    inner = Frame(1, 2, 0.5, np.pi / 2).at(1, 0, 0.25, 0.1)
    assert (inner.x, inner.y, inner.z, inner.yaw) == pytest.approx((1, 3, 0.75, np.pi / 2 + 0.1))


def test_objects_are_numbered_from_one_and_keep_their_class() -> None:
    builder = Builder()
    builder.background(Frame()).cuboid((0, 0, 0), (1, 1, 1), GREY)
    for name in CLASSES:
        builder.object(Frame(), name).cuboid((0, 0, 0), (1, 1, 1), GREY)
    assert builder.cuboids().instances.tolist() == [BACKGROUND, 1, 2, 3]
    assert builder.instance_classes == [-1, 0, 1, 2]


def test_corners_follow_the_frame() -> None:
    builder = Builder()
    builder.background(Frame(10, 0, 0, np.pi / 2)).cuboid((1, 0, 0), (0.5, 0.2, 0.1), GREY)
    corners = builder.cuboids().corners()[0]
    assert corners.min(axis=0) == pytest.approx([9.8, 0.5, -0.1], abs=1e-6)
    assert corners.max(axis=0) == pytest.approx([10.2, 1.5, 0.1], abs=1e-6)


def test_a_tilted_cuboid_keeps_its_second_axis_level() -> None:
    builder = Builder()
    builder.background(Frame(yaw=0.7)).cuboid((0, 0, 0), (1, 1, 1), GREY, pitch=0.4, yaw=0.2)
    assert builder.cuboids().rotations[0, 2, 1] == 0


def test_a_wheel_is_as_high_as_it_is_long() -> None:
    builder = Builder()
    builder.background(Frame()).wheel((0, 0, 0.3), 0.3, 0.1, GREY)
    extent = np.ptp(builder.cuboids().corners().reshape(-1, 3), axis=0)
    assert extent == pytest.approx([0.555, 0.2, 0.555], abs=0.01)
