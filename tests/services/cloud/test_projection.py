from typing import NoReturn

import numpy as np
import pytest
from numpy.typing import NDArray

from services.cloud.outlines import RING, Candidates, Masked
from services.cloud.points import Points
from services.cloud.views import ProjectedView
from services.geometry.camera import CameraModel
from services.geometry.masks import Window
from tests.services.cloud.clouds import xyz_cloud
from tests.services.cloud.scenes import CAMERA, HEIGHT, OPTICAL_IN_BASE, WIDTH, Cuboid, camera_view, lidar_view
from tests.services.geometry.cameras import LENSES, camera

WHOLE = Window(0, 0, np.ones((HEIGHT, WIDTH), np.bool_))
NEAR, FAR = Cuboid((3.0, 0.3), (0.6, 0.8, 0.7)), Cuboid((5.0, -0.9), (0.8, 0.8, 1.2), yaw=0.4)


def lidar_at(*origin: float) -> NDArray[np.float64]:
    """Return the transform that moves points of a level lidar there into the camera's optical frame."""
    in_base = np.identity(4)
    in_base[:3, 3] = origin
    return np.asarray(np.linalg.inv(OPTICAL_IN_BASE) @ in_base)


def masked(window: Window) -> Masked:
    """Return a mask whose edge is trusted."""
    return Masked(window, window)


def seen(points: NDArray[np.float32], transform: NDArray[np.float64], *windows: Window) -> list[Candidates]:
    view = ProjectedView(Points.of(xyz_cloud(points[None])), CAMERA, transform)
    return list(view.within([masked(window) for window in windows]))


class Unread(Points):
    """Fails if its points are looked at."""

    def xyz(self) -> NoReturn:
        raise AssertionError


def test_where_nothing_was_found_no_points_are_projected() -> None:
    points = Points.of(xyz_cloud(camera_view((NEAR,))[0]))
    view = ProjectedView(Unread(points.records, points.axes, points.channels), CAMERA, np.identity(4))
    assert list(view.within([])) == []


def test_points_are_seen_where_the_camera_model_puts_them() -> None:
    picture, owners = camera_view((NEAR, FAR))
    points = picture.reshape(-1, 3)
    for number in (1, 2):
        (found,) = seen(points, np.identity(4), Window(0, 0, owners == number))
        assert found.points.at.tolist() == np.flatnonzero(owners.ravel() == number).tolist()
        assert found.points.xyz == pytest.approx(points[found.points.at].T)
        assert found.depth == pytest.approx(points[found.points.at, 2])


def test_colours_stay_with_their_points_whoevers_they_are() -> None:
    picture, owners = camera_view((NEAR, FAR))
    rgb = np.random.default_rng(2).integers(0, 256, picture.shape, np.uint8)
    view = ProjectedView(Points.of(xyz_cloud(picture, rgb)), CAMERA, np.identity(4))
    for found in view.within([masked(Window(0, 0, owners == number)) for number in (2, 1)]):
        assert found.points.rgb is not None
        assert found.points.at.size
        assert np.array_equal(found.points.rgb, rgb.reshape(-1, 3)[found.points.at])
        assert np.array_equal(found.points.xyz, picture.reshape(-1, 3)[found.points.at].T)


def test_what_is_just_around_an_object_is_told_with_it() -> None:
    picture, owners = camera_view((NEAR, FAR))
    points, (rows, columns) = picture.reshape(-1, 3), np.nonzero(owners == 1)
    window = Window(
        int(rows.min()), int(columns.min()), (owners == 1)[rows.min() : rows.max() + 1, columns.min() :][:, :9]
    )
    (found,) = seen(points, np.identity(4), window)
    ring = masked(window).around(HEIGHT, WIDTH)
    assert ring.pixels.shape[1] == 9 + 2 * RING
    shown = picture[..., 2][ring.place][ring.pixels]
    assert 0.95 * len(shown) < len(found.around) <= len(shown)  # some of it is hidden
    assert set(found.around.tolist()) <= set(shown.tolist())


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_any_lens_is_honoured(lens: tuple[str, list[float]]) -> None:
    bent: CameraModel = camera(lens=lens)
    rows, columns = np.mgrid[3:45:3, 3:60:3]
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    points = bent.unproject(pixels, np.full(len(pixels), 2.5)).astype(np.float32)
    outside = np.array([[9, 0, 1], [0, 9, 1], [0, 0, -1], [-9, 0, 1]], np.float32)
    view = ProjectedView(Points.of(xyz_cloud(np.concatenate([points, outside])[None])), bent, np.identity(4))
    for number, (column, row) in enumerate(pixels[::17]):
        (found,) = view.within([masked(Window(int(row), int(column), np.ones((1, 1), np.bool_)))])
        assert found.points.at.tolist() == [17 * number]
    (everything,) = view.within([masked(Window(0, 0, np.ones((48, 64), np.bool_)))])
    assert everything.points.at.tolist() == list(range(len(pixels)))


def test_a_lidar_that_sees_over_an_object_gives_it_nothing_from_behind_it() -> None:
    origin = np.array([0.0, 0.0, 2.5])
    points, owners = lidar_view((NEAR, FAR), origin)
    _, shown = camera_view((NEAR, FAR))
    windows = [Window(0, 0, shown == number) for number in (1, 2)]
    for number, found in enumerate(seen(points, lidar_at(*origin), *windows), start=1):
        mine = owners[found.points.at] == number
        assert mine.sum() > 50
        assert mine.mean() > 0.9
        assert (found.depth[~mine] < 7.0).all()  # the wall behind, which the lidar sees over the box, is hidden


def test_what_the_lidar_sees_beside_the_camera_is_not_seen() -> None:
    points = np.array([[[2, 0, 1], [-2, 0, 1], [2, 5, 1], [2, 0, 9], [0.01, 0, 1]]], np.float32)[0]
    (found,) = seen(points, lidar_at(0, 0, 0), WHOLE)
    assert found.points.at.tolist() == [0]


def test_no_reading_is_no_point() -> None:
    nan, inf = float("nan"), float("inf")
    points = np.array([[nan, 0, 1], [2, 0, nan], [inf, 0, 0], [2, 0, inf], [0, 0, 0], [2, 0, 1]], np.float32)
    (found,) = seen(points, lidar_at(3, 0, 1), WHOLE)
    assert found.points.at.tolist() == [5]


def test_where_masks_overlap_the_first_one_has_the_points() -> None:
    points = np.array([[2, 0, 1]], np.float32)
    first, second, third = seen(points, lidar_at(0, 0, 0), Window(0, 0, np.zeros((0, 0), np.bool_)), WHOLE, WHOLE)
    assert (first.points.at.size, second.points.at.tolist(), third.points.at.size) == (0, [0], 0)


def test_no_masks_and_no_points_are_no_candidates() -> None:
    assert seen(np.ones((3, 3), np.float32), np.identity(4)) == []
    (found,) = seen(np.zeros((0, 3), np.float32), np.identity(4), WHOLE)
    assert found.points.at.size == 0
