import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo
from schemas.header import Header
from schemas.transforms import Transform
from services.cloud.outlines import CloudView, RegisteredView
from services.cloud.points import CloudError, Points
from services.cloud.views import NO_INFO, Instant, ProjectedView, moves_of, target_of, view_of
from services.geometry.errors import CalibrationError
from services.geometry.transforms import LITTLE, TransformTree
from tests.schemas.frames import header
from tests.services.cloud.clouds import xyz_cloud
from tests.services.cloud.scenes import HEIGHT, WIDTH, Cuboid, camera_view, detections
from tests.services.geometry.cameras import info

SAME = np.identity(4)
INFO = info(height=HEIGHT, width=WIDTH, focal=480.0)
EMPTY = msgspec.structs.replace(INFO, k=[0.0] * 9)
"""What a driver sends that has no calibration."""

BOXES = (Cuboid((4.0, 0.6), (0.6, 0.9, 0.7)),)


def instant(
    points: NDArray[np.float32], *, calibration: CameraInfo | None = INFO, moves: NDArray[np.float64] | str = SAME
) -> Instant:
    cloud = xyz_cloud(points)
    return Instant(detections(), Points.of(cloud), cloud.header, calibration, moves)


def picture() -> NDArray[np.float32]:
    return camera_view(BOXES)[0]


@pytest.mark.parametrize("calibration", [INFO, None, EMPTY])
@pytest.mark.parametrize("factor", [1, 2, 4])
def test_a_cloud_that_lies_on_the_pixels_is_registered(factor: int, calibration: CameraInfo | None) -> None:
    coarse = picture()[factor // 2 :: factor, factor // 2 :: factor]
    view = view_of(instant(coarse, calibration=calibration))
    assert isinstance(view, RegisteredView)
    assert view.factor == factor


def test_a_cloud_that_only_looks_registered_is_projected() -> None:
    assert isinstance(view_of(instant(picture()[:, ::-1])), ProjectedView)


@pytest.mark.parametrize("shape", [(1, HEIGHT * WIDTH), (WIDTH, HEIGHT)])
def test_a_cloud_of_another_shape_is_projected(shape: tuple[int, int]) -> None:
    assert isinstance(view_of(instant(picture().reshape(*shape, 3))), ProjectedView)


def test_a_cloud_from_elsewhere_is_projected_though_it_has_the_pictures_size() -> None:
    aside = SAME.copy()
    aside[0, 3] = 0.05
    assert isinstance(view_of(instant(picture(), moves=aside)), ProjectedView)


def test_a_cloud_without_readings_is_no_reason_to_project() -> None:
    assert isinstance(view_of(instant(np.full((HEIGHT, WIDTH, 3), np.nan, np.float32))), RegisteredView)


def test_what_is_missing_is_said() -> None:
    lidar = picture().reshape(1, -1, 3)
    with pytest.raises(CloudError, match=NO_INFO):
        view_of(instant(lidar, calibration=None))
    with pytest.raises(CloudError, match="cannot be projected into the image: nothing is known"):
        view_of(instant(picture(), moves="nothing is known of frame 'lidar'"))
    with pytest.raises(CalibrationError, match="calibrated for 64x48 pixels"):
        view_of(instant(lidar, calibration=info()))
    with pytest.raises(CalibrationError, match="not calibrated: its camera info has no focal length"):
        view_of(instant(lidar, calibration=EMPTY))


def at(stamp_ns: int, frame_id: str) -> Header:
    return msgspec.structs.replace(header(), stamp_ns=stamp_ns, frame_id=frame_id)


def tree(*said: tuple[str, str, int, float], static: bool = False) -> TransformTree:
    """Return a tree of frames: parent, child, stamp, and how far the child is along the parent's x."""
    made = TransformTree()
    for parent, child, stamp_ns, x in said:
        transform = Transform(
            frame_id=parent,
            child_frame_id=child,
            stamp_ns=stamp_ns,
            translation=(x, 0.0, 0.0),
            rotation=(0.0, 0.0, 0.0, 1.0),
        )
        made.add(transform, static=static or stamp_ns == 0)
    return made


def test_points_of_another_instant_are_seen_through_what_stands_still() -> None:
    driving = tree(("map", "base_link", 1000, 0.0), ("map", "base_link", 2000, 1.0))
    for transform in (("base_link", "lens", 0, 0.2), ("base_link", "lidar", 0, -0.3)):
        parent, child, _, x = transform
        driving.add(
            Transform(
                frame_id=parent,
                child_frame_id=child,
                stamp_ns=0,
                translation=(x, 0.0, 0.0),
                rotation=(0.0, 0.0, 0.0, 1.0),
            ),
            static=True,
        )
    moves = moves_of(at(2000, "lens"), at(1500, "lidar"), driving)
    assert not isinstance(moves, str)
    assert moves[:3, 3] == pytest.approx([-1.0, 0, 0])  # half a metre of driving, and half a metre apart
    same = moves_of(at(2000, "lens"), at(2000, "lidar"), driving)
    assert not isinstance(same, str)
    assert same[:3, 3] == pytest.approx([-0.5, 0, 0])


@pytest.mark.parametrize(("moved_m", "kind"), [(0.9 * LITTLE, RegisteredView), (1.1 * LITTLE, ProjectedView)])
def test_a_registered_cloud_stays_one_while_the_robot_hardly_moves(moved_m: float, kind: type[CloudView]) -> None:
    creeping = tree(("odom", "lens", 1000, 0.0), ("odom", "lens", 2000, moved_m))
    assert isinstance(view_of(instant(picture(), moves=moves_of(at(2000, "lens"), at(1000, "lens"), creeping))), kind)


def test_a_correction_of_the_map_is_no_movement_of_the_robot() -> None:
    at_rest = (("odom", "base_link", 0, 5.0), ("base_link", "lens", 0, 0.2), ("base_link", "lidar", 0, -0.3))
    corrected = tree(("map", "odom", 1000, 0.0), ("map", "odom", 2000, 1.0), *at_rest)
    moves = moves_of(at(2000, "lens"), at(1500, "lidar"), corrected)
    assert not isinstance(moves, str)
    assert moves[:3, 3] == pytest.approx([-0.5, 0, 0])


def test_without_what_stands_still_nothing_is_taken_to_have_moved() -> None:
    fixed = tree(("base_link", "lens", 0, 0.2), ("base_link", "lidar", 0, -0.3))
    moves = moves_of(at(2000, "lens"), at(1500, "lidar"), fixed)
    assert not isinstance(moves, str)
    assert moves[:3, 3] == pytest.approx([-0.5, 0, 0])


def test_one_frame_needs_no_transforms_and_two_do() -> None:
    nothing = TransformTree()
    for stamp_ns in (5, 6):
        moves = moves_of(at(5, "lens"), at(stamp_ns, "lens"), nothing)
        assert not isinstance(moves, str)
        assert moves == pytest.approx(SAME)
    assert moves_of(at(5, "lens"), at(5, "lidar"), nothing) == "nothing is known of frame 'lens'"


def test_a_loop_of_transforms_is_a_reason() -> None:
    circle = tree(("a", "lens", 0, 1.0), ("lens", "a", 0, 1.0))
    assert "ancestor" in str(moves_of(at(5, "lens"), at(5, "a"), circle))


def test_where_the_target_is_or_why_not() -> None:
    known = target_of("base_link", at(5, "lens"), tree(("base_link", "lens", 0, 0.2)))
    assert known.from_points is not None
    assert known.from_points[:3, 3] == pytest.approx([0.2, 0, 0])
    assert target_of("", at(5, "lens"), TransformTree()).unknown == ""
    assert target_of("lens", at(5, "/lens"), TransformTree()).from_points == pytest.approx(SAME)
    future = tree(("base_link", "lens", 1_000, 0.2), ("base_link", "lens", 2_000, 0.2))
    assert "before the stamp" in target_of("base_link", at(9_000, "lens"), future).unknown


def test_a_target_farther_away_than_messages_carry_is_unknown() -> None:
    far = tree(("utm", "map", 0, 8e8), ("map", "lens", 0, 8e8))
    target = target_of("utm", at(0, "lens"), far)
    assert target.from_points is None
    assert target.unknown == "utm is more than 5e+08 m away according to the transforms"
