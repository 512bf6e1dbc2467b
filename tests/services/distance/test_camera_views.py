"""Views for the world model: outlines of what is seen, in the map, and how far the camera saw."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.distances import CameraView
from services.distance.camera_views import COLUMNS, ROWS, Place, ViewMaker, motion
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView
from services.geometry.camera import CameraModel
from services.geometry.depth import Depth
from tests.services.distance.scenes import FOCAL, FRAME, HEIGHT, WIDTH, calibration, detections, found, mask, wall

AHEAD = np.array([[0.0, 0, 1, 10], [-1, 0, 0, 20], [0, -1, 0, 0.5], [0, 0, 0, 1]])
"""Of a camera at (10, 20, 0.5) that looks along the map's x axis."""

BOX = mask(slice(12, 30), slice(20, 44))


def scene(box_m: float = 2.0, wall_m: float = 4.0) -> NDArray[np.float32]:
    depth = wall(wall_m)
    depth[BOX] = box_m
    return depth


def view(depth: Any, place: Any = AHEAD, camera: Any = None) -> CameraView:
    model = CameraModel.of(calibration()) if camera is None else camera
    seen = DepthView(Depth(depth), FRAME, model) if not isinstance(depth, str) else depth
    return ViewMaker(Criteria(), "w").view(detections(found(BOX)), seen, Place("map", place, 0.5, 0.1))


def test_a_view_says_where_the_surface_of_an_object_reaches_to() -> None:
    said = view(scene())
    (box,) = said.objects
    right, left, lower, upper = (edge / FOCAL * 2.0 for edge in (12, 12, 5.5, 11.5))
    assert box.at == pytest.approx((12.0, 20.0, 0.62), abs=0.02)
    assert box.depth_m == pytest.approx(2.0)
    assert (box.low_m, box.high_m) == pytest.approx((0.5 - lower, 0.5 + upper), abs=0.05)
    reach = np.array(box.reach_mm) / 1000
    assert reach[[0, 6]] == pytest.approx([0, 0], abs=0.01)
    assert reach[[3, 9]] == pytest.approx([left, right], abs=0.05)
    assert (said.position, said.speed, said.turn) == ((10.0, 20.0, 0.5), 0.5, 0.1)
    assert said.rotation == pytest.approx((-0.5, 0.5, -0.5, 0.5))


def test_the_grid_says_how_far_the_camera_saw() -> None:
    grid = view(scene()).grid
    assert grid is not None
    near, far = (np.frombuffer(each, "<u2").reshape(ROWS, COLUMNS) for each in (grid.near_mm, grid.far_mm))
    assert (near[0, 0], far[0, 0]) == (4000, 4000)
    inside = near[HEIGHT // 2 * ROWS // HEIGHT, WIDTH // 2 * COLUMNS // WIDTH]
    assert inside == 2000
    x, y, z = 0.0, 0.0, 2.0
    column, row = int(grid.fx * x / z + grid.cx), int(grid.fy * y / z + grid.cy)
    assert far[row, column] == 2000


def test_cells_without_half_their_readings_say_nothing() -> None:
    depth = scene()
    depth[:, : WIDTH // 2] = np.nan
    grid = view(depth).grid
    assert grid is not None
    near = np.frombuffer(grid.near_mm, "<u2").reshape(ROWS, COLUMNS)
    assert (near[:, : COLUMNS // 2 - 1] == 0).all()
    assert (near[:, COLUMNS // 2 + 1 :] > 0).all()


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (view(scene(), "no transform to map"), "no transform to map"),
        (view(scene(), AHEAD * 1e12), "farther away than any place"),
    ],
    ids=["unknown", "far"],
)
def test_a_camera_that_is_nowhere_says_so(said: CameraView, why: str) -> None:
    assert why in said.unlocated
    assert (said.position, said.objects, said.unmeasured) == (None, [], {"box": 1})


@pytest.mark.parametrize(
    ("said", "why"),
    [(view("no depth image arrived"), "no depth"), (view(scene(), camera="no camera info arrived"), "no camera info")],
    ids=["depth", "camera"],
)
def test_a_view_without_depth_says_why(said: CameraView, why: str) -> None:
    assert why in said.unseen
    assert (said.grid, said.objects) == (None, [])
    assert said.position is not None


def test_motion_is_how_fast_a_pose_changes() -> None:
    turned = np.identity(4)
    turned[:2, :2] = [[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]]
    turned[0, 3] = 0.3
    assert motion(np.identity(4), turned, 0.1) == pytest.approx((3.0, 2.0))
