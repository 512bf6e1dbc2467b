import numpy as np
import pytest

from services.simulator.world import Camera, organised_cloud

CAMERA = Camera(8, 6, 10.0, 5.0, 3.5, 2.5)


def test_points_project_back_to_their_pixels() -> None:
    depth = np.random.default_rng(1).uniform(0.5, 5, (6, 8)).astype(np.float32)
    cloud = organised_cloud(depth, CAMERA)
    assert cloud.shape == (6, 8, 3)
    assert cloud.dtype == np.float32
    assert np.array_equal(cloud[..., 2], depth)
    columns, rows = np.meshgrid(np.arange(8), np.arange(6))
    assert cloud[..., 0] / cloud[..., 2] * 10.0 + 3.5 == pytest.approx(columns, abs=1e-5)
    assert cloud[..., 1] / cloud[..., 2] * 5.0 + 2.5 == pytest.approx(rows, abs=1e-5)


def test_without_depth_there_is_no_point() -> None:
    depth = np.full((6, 8), 2.0, np.float32)
    depth[1, 2], depth[3, 4] = 0, np.nan
    none = np.isnan(organised_cloud(depth, CAMERA))
    assert none[1, 2].all()
    assert none[3, 4].all()
    assert none.sum() == 6
