import math

import numpy as np
import pytest

from schemas.objects import UprightBox
from services.toolbox.clouds.drawing import EDGES, corners_of, drawing_of
from tests.schemas.results import cloud, clouds


def test_points_are_drawn_in_their_colours_and_each_object_in_its_box() -> None:
    seen = clouds(cloud((0.5, 0.25, 2.0), rgb=bytes([255, 0, 51])), cloud((1.0, 2.0, 3.0)))
    drawing = drawing_of(seen)
    assert drawing.xyz.tolist() == [[0.5, 0.25, 2.0], [1.0, 2.0, 3.0]]
    assert drawing.rgb.tolist() == [[1.0, 0.0, 0.2], [1.0, 1.0, 1.0]]
    assert (drawing.corners.shape, drawing.edges.shape) == ((16, 3), (24, 2))
    assert set(drawing.edges[12:].ravel().tolist()) == set(range(8, 16))
    assert drawing.up == seen.objects[0].shape.box.up


def test_nothing_in_view_is_an_empty_drawing() -> None:
    drawing = drawing_of(clouds())
    assert [array.shape for array in (drawing.xyz, drawing.rgb, drawing.corners, drawing.edges)] == [
        (0, 3),
        (0, 3),
        (0, 3),
        (0, 2),
    ]


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)])
def test_a_box_has_its_sides_wherever_is_up(up: tuple[float, float, float]) -> None:
    box = UprightBox(centre=(1.0, 2.0, 3.0), size=(2.0, 1.0, 0.5), yaw=0.7, up=up)
    corners = corners_of(box)
    assert corners.mean(axis=0) == pytest.approx([1, 2, 3])
    assert sorted(np.linalg.norm(corners[a] - corners[b]) for a, b in EDGES) == pytest.approx(
        [0.5] * 4 + [1.0] * 4 + [2.0] * 4
    )
    heights = corners @ np.array(up)
    assert np.ptp(heights) == pytest.approx(0.5)


def test_yaw_turns_the_length_counter_clockwise() -> None:
    corners = corners_of(UprightBox(centre=(0, 0, 0), size=(2.0, 0.0, 0.0), yaw=math.pi / 6))
    assert np.abs(corners).max(axis=0) == pytest.approx([math.cos(math.pi / 6), 0.5, 0])
    assert (corners[:, 0] * corners[:, 1] > 0).all()
