import numpy as np
import pytest

from services.simulator.messages import WHITE, colored_points, metres, packed, projected, ringed_points
from services.simulator.placement import at
from services.simulator.world import Camera, Turn

CAMERA = Camera(width=3, height=2, fx=2.0, fy=2.0, cx=1.0, cy=0.5)
PICTURE = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)


def test_millimetres_become_metres_and_no_reading_no_number() -> None:
    found = metres(np.array([[1500, 0, 65535]], np.uint16))
    assert found.dtype == np.float32
    assert found[0, [0, 2]] == pytest.approx([1.5, 65.535])
    assert np.isnan(found[0, 1])


def test_colours_are_packed_as_pcl_does() -> None:
    assert packed(PICTURE)[0, 1] == 0x030405
    assert packed(PICTURE).dtype == np.uint32


def test_points_are_organised_like_the_image() -> None:
    depth = np.array([[2, 2, np.nan], [4, 4, 4]], np.float32)
    points = colored_points(depth, CAMERA, packed(PICTURE))
    assert points.shape == (2, 3)
    assert points[1, 2].tolist()[:3] == pytest.approx([2.0, 1.0, 4.0])
    assert np.isnan(points["x"][0, 2])
    assert np.isnan(points["z"][0, 2])
    assert np.array_equal(points["rgb"].view(np.uint32), packed(PICTURE))


def test_colour_is_looked_up_where_a_point_is_in_the_picture() -> None:
    depth = np.full((2, 3), 2, np.float32)
    depth[1, 1] = np.nan
    rgb = packed(PICTURE)
    assert np.array_equal(projected(rgb, CAMERA, depth, CAMERA, np.eye(4))[0], rgb[0])
    beside = projected(rgb, CAMERA, depth, CAMERA, at(x=1.0))  # a metre at two metres is a pixel here
    assert beside[0].tolist() == [rgb[0, 1], rgb[0, 2], WHITE]
    assert beside[1].tolist() == [rgb[1, 1], WHITE, WHITE]


def test_a_lidars_points_have_the_fields_of_its_driver() -> None:
    turn = Turn(
        np.array([[1, 2, 3], [4, 5, 6]], np.float32),
        np.array([10, 20], np.float32),
        np.array([0, 15], np.uint16),
        np.array([0, 0], np.int32),
    )
    points = ringed_points(turn)
    assert points.shape == (1, 2)
    assert points.dtype.itemsize == 22
    assert points[0].tolist() == [(1, 2, 3, 10, 0, 0), (4, 5, 6, 20, 15, 0)]
