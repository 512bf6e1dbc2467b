import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.simulator.world import Camera, Pose
from services.simulator.world.cuboids import Builder, Cuboids, Frame, Material, Paint
from services.simulator.world.silhouette import Silhouette, Spans

PAINT = Paint(Material.PLAIN, (1, 1, 1))
CAMERA = Camera(64, 48, 50.0, 50.0, 31.5, 23.5)
AHEAD = Pose.looking(0, 0, 0, 0)


def block(centre: tuple[float, float, float], half: tuple[float, float, float], yaw: float = 0.0) -> Cuboids:
    builder = Builder()
    builder.object(Frame(), "box").cuboid(centre, half, PAINT, yaw=yaw)
    return builder.cuboids()


def square(left: float, top: float, right: float, bottom: float) -> list[tuple[float, float]]:
    return [(left, top), (right, top), (right, bottom), (left, bottom)]


def test_a_span_holds_the_pixels_whose_centre_is_inside() -> None:
    spans = Spans.of(np.array([square(1.2, 1.9, 4.1, 4.0)]), range(10))
    assert spans.rows.tolist() == [2, 3, 4]
    assert spans.starts.tolist() == [2, 2, 2]
    assert spans.ends.tolist() == [4, 4, 4]
    assert spans.area() == 9


def test_a_polygon_between_the_centres_covers_nothing() -> None:
    assert Spans.of(np.array([square(1.2, 1.2, 1.8, 8.0)]), range(10)).area() == 0
    assert Spans.of(np.array([square(1.2, 1.2, 8.0, 1.8)]), range(10)).area() == 0


def test_what_two_polygons_share_counts_once() -> None:
    polygons = np.array([square(0, 0, 3, 1), square(2, 0, 5, 1), square(9, 0, 9, 1)], np.float64)
    assert Spans.of(polygons, range(10)).area() == 2 * (6 + 1)


@given(st.lists(st.tuples(*[st.integers(-5, 25)] * 4), min_size=1, max_size=6))
def test_the_area_is_that_of_the_pixels(corners: list[tuple[int, int, int, int]]) -> None:
    polygons = np.array([square(min(a, c), min(b, d), max(a, c), max(b, d)) for a, b, c, d in corners], np.float64)
    spans = Spans.of(polygons, range(-5, 26))
    _, rows, columns = spans.pixels()
    assert spans.area() == len(set(zip(rows.tolist(), columns.tolist(), strict=True)))


def test_an_object_in_the_middle_is_wholly_inside() -> None:
    outline = Silhouette.of(block((3, 0, 0), (0.5, 0.4, 0.3)), AHEAD, CAMERA)
    assert outline.outside == 0
    assert len(set(zip(outline.rows.tolist(), outline.columns.tolist(), strict=True))) == 16 * 12
    assert outline.inverse_depth == pytest.approx(np.full(16 * 12, 1 / 2.5))


def test_what_the_border_cuts_off_is_outside() -> None:
    outline = Silhouette.of(block((3, 0, 0), (0.5, 4, 0.3)), AHEAD, CAMERA)
    assert outline.outside == 160 * 12 - 64 * 12
    seen = np.zeros((48, 64), np.bool_)
    seen[18:30] = True
    assert outline.visibility(seen, np.full((48, 64), 2.5, np.float32)) == pytest.approx(0.4)


def test_only_what_is_nearer_hides() -> None:
    outline = Silhouette.of(block((3, 0, 0), (0.5, 0.4, 0.3)), AHEAD, CAMERA)
    seen = np.zeros((48, 64), np.bool_)
    seen[18:24, 24:40] = True
    depth = np.full((48, 64), 2.5, np.float32)
    depth[24:30] = 2.0
    assert outline.visibility(seen, depth) == pytest.approx(0.5)
    depth[24:30] = 2.6
    assert outline.visibility(seen, depth) == 1
    depth[24:30] = 0
    assert outline.visibility(seen, depth) == 1
    depth[24:30] = 2.0
    assert outline.visibility(np.zeros_like(seen), depth) == 0


def test_what_reaches_behind_the_camera_ends_at_the_near_plane() -> None:
    outline = Silhouette.of(block((0, 0.5, 0), (4, 0.2, 0.2)), AHEAD, CAMERA)
    expected = 50 * 50 * (0.4 / 0.3) * (0.3 / 2) * (1 / 0.05**2 - 1 / 4**2) * 0.3
    assert outline.outside == pytest.approx(expected, rel=0.02)


def test_an_object_behind_the_camera_has_no_outline() -> None:
    outline = Silhouette.of(block((-3, 0, 0), (0.5, 0.4, 0.3)), AHEAD, CAMERA)
    assert outline.outside == 0
    assert len(outline.rows) == 0
