import numpy as np
import pytest

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.cuboids import Builder, Cuboids, Frame, Material, Paint
from services.simulator.world.visibility import find_visible

GREY = Paint(Material.PLAIN, (0.5, 0.5, 0.5))
CAMERA = Camera.with_field_of_view(64, 48, np.pi / 2)
AHEAD = Pose.looking(0, 0, 0, 0)


def blocks(*centres_and_halves: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Cuboids:
    builder = Builder()
    for centre, half in centres_and_halves:
        builder.background(Frame()).cuboid(centre, half, GREY)
    return builder.cuboids()


def test_a_facing_wall_has_the_same_depth_everywhere() -> None:
    seen = find_visible(blocks(((5, 0, 0), (1, 20, 20))), AHEAD, CAMERA)
    assert (seen.slots == 0).all()
    assert 1 / seen.inverse_depth == pytest.approx(np.full((48, 64), 4.0), rel=1e-5)


def test_a_floor_recedes_as_geometry_says() -> None:
    seen = find_visible(blocks(((0, 0, -1.5), (50, 50, 0.5))), AHEAD, CAMERA)
    row = 40
    assert 1 / seen.inverse_depth[row, 10] == pytest.approx(CAMERA.fy * 1.0 / (row - CAMERA.cy), rel=1e-3)
    assert (seen.slots[:20] == -1).all()
    assert (seen.inverse_depth[:20] == 0).all()


def test_the_nearer_of_two_hides_the_farther_whatever_their_order() -> None:
    near, far = ((2, 0, 0), (0.1, 0.5, 0.5)), ((4, 0, 0), (0.1, 9, 9))
    one = find_visible(blocks(near, far), AHEAD, CAMERA)
    other = find_visible(blocks(far, near), AHEAD, CAMERA)
    assert np.array_equal(one.inverse_depth, other.inverse_depth)
    assert 1 / one.inverse_depth[24, 32] == pytest.approx(1.9)
    assert 1 / one.inverse_depth[24, 2] == pytest.approx(3.9)


def test_a_block_covers_the_pixels_that_it_projects_to() -> None:
    seen = find_visible(blocks(((3, 0, 0), (1, 0.5, 0.25))), AHEAD, CAMERA)
    rows, columns = np.nonzero(seen.slots >= 0)
    half_width, half_height = CAMERA.fx * 0.5 / 2, CAMERA.fy * 0.25 / 2
    assert columns.min() == pytest.approx(CAMERA.cx - half_width, abs=0.51)
    assert columns.max() == pytest.approx(CAMERA.cx + half_width, abs=0.51)
    assert rows.max() - rows.min() == pytest.approx(2 * half_height, abs=1)


def test_what_is_behind_or_beside_is_not_seen() -> None:
    seen = find_visible(blocks(((-3, 0, 0), (1, 1, 1)), ((1, 30, 0), (1, 1, 1))), AHEAD, CAMERA)
    assert (seen.slots == -1).all()
    assert len(seen.faces) == 0


def test_faces_that_reach_behind_the_camera_are_cut() -> None:
    seen = find_visible(blocks(((0, 1.5, 0), (40, 0.5, 40))), AHEAD, CAMERA)
    left = 1 / seen.inverse_depth[:, 0]
    assert left == pytest.approx(np.full(48, CAMERA.fx / CAMERA.cx), rel=1e-4)
    assert (seen.slots[:, 40:] == -1).all()
