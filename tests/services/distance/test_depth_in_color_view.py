from typing import Any

import msgspec
import numpy as np
import pytest

from schemas.camera_info import CameraInfo
from services.distance.depth_in_color_view import NO_INFO, DepthLimits, Instant, Views
from services.geometry.camera import CameraModel
from services.geometry.errors import DepthError, GeometryError
from tests.services.distance.scenes import FRAME, calibration, depth, detections, wall
from tests.services.geometry.cameras import info

HERE = np.identity(4)
BESIDE = np.array([[1, 0, 0, -0.4], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
COLOR = calibration()
COARSE = info(height=24, width=32, focal=25.0)
EMPTY = msgspec.structs.replace(COLOR, k=[0.0] * 9, distortion_model="")
"""What a driver sends that has no calibration."""


def instant(of_depth: Any, color: CameraInfo | None, depth_info: CameraInfo | None, between: Any = HERE) -> Instant:
    return Instant(detections([]), of_depth, color, depth_info, between)


def test_depth_of_the_colour_camera_is_taken_as_it_is() -> None:
    views = Views(DepthLimits())
    image, camera = views.view(instant(depth(wall(2.0)), COLOR, COLOR))
    assert (image.metres() == 2).all()
    assert isinstance(camera, CameraModel)
    assert views.view(instant(depth(wall(2.0)), COLOR, COLOR))[1] is camera


@pytest.mark.parametrize("frame_id", [FRAME, f"/{FRAME}"])
@pytest.mark.parametrize(("color", "depth_info"), [(COLOR, None), (None, COLOR), (COLOR, EMPTY), (EMPTY, COLOR)])
def test_one_calibration_is_enough_for_images_of_one_size_and_frame(
    color: CameraInfo | None, depth_info: CameraInfo | None, frame_id: str
) -> None:
    image, camera = Views(DepthLimits()).view(instant(depth(wall(2.0), frame_id=frame_id), color, depth_info))
    assert (image.metres() == 2).all()
    assert isinstance(camera, CameraModel)


def test_without_any_calibration_images_of_one_size_and_frame_are_taken_for_registered() -> None:
    image, camera = Views(DepthLimits()).view(instant(depth(wall(2.0)), None, None))
    assert (image.metres() == 2).all()
    assert camera == NO_INFO


@pytest.mark.parametrize(("color", "depth_info"), [(EMPTY, EMPTY), (EMPTY, None), (None, EMPTY)])
def test_a_camera_info_of_no_calibration_is_as_good_as_none(
    color: CameraInfo | None, depth_info: CameraInfo | None
) -> None:
    image, camera = Views(DepthLimits()).view(instant(depth(wall(2.0)), color, depth_info))
    assert (image.metres() == 2).all()
    assert camera == "the camera is not calibrated: its camera info has no focal length"


def test_depth_of_another_size_is_registered() -> None:
    image, _ = Views(DepthLimits()).view(instant(depth(wall(2.0)[:24, :32]), COLOR, COARSE))
    assert image.shape == (48, 64)
    assert np.nanmax(image.metres()) == np.nanmin(image.metres()) == 2
    assert np.isnan(image.metres()).mean() < 0.1


def test_depth_from_beside_is_registered_by_the_transform() -> None:
    seen = instant(depth(wall(2.0), frame_id="camera_depth_optical_frame"), COLOR, COLOR, BESIDE)
    image, _ = Views(DepthLimits()).view(seen)
    assert np.isnan(image.metres()[:, -10:]).all()
    assert (image.metres()[:, :-10] == 2).all()


def test_a_new_calibration_counts_from_then_on() -> None:
    views = Views(DepthLimits())
    first = views.view(instant(depth(wall(2.0)[:24, :32]), COLOR, COARSE))
    narrow = msgspec.structs.replace(COARSE, k=info(height=24, width=32, focal=50.0).k)
    second = views.view(instant(depth(wall(2.0)[:24, :32]), COLOR, narrow))
    again = views.view(instant(depth(wall(2.0)[:24, :32]), COLOR, COARSE))
    assert np.array_equal(first[0].metres(), again[0].metres(), equal_nan=True)
    assert not np.array_equal(first[0].metres(), second[0].metres(), equal_nan=True)


def test_many_calibrations_are_not_all_kept() -> None:
    views = Views(DepthLimits())
    for focal in range(40, 60):
        views.view(instant(depth(wall(2.0)), info(focal=focal), None))
    assert len(views._models) <= 4


@pytest.mark.parametrize(
    ("seen", "reason"),
    [
        (
            instant(depth(wall(2.0)[:24, :32]), COLOR, None),
            "depth cannot be registered to colour: of depth no camera info",
        ),
        (instant(depth(wall(2.0)[:24, :32]), None, COARSE), "of colour no camera info arrived"),
        (instant(depth(wall(2.0), frame_id="other"), None, None), "of colour no camera info arrived"),
        (instant(depth(wall(2.0)[:24, :32]), EMPTY, COARSE), "of colour the camera is not calibrated: its camera info"),
        (instant(depth(wall(2.0), frame_id="other"), COLOR, EMPTY), "of depth the camera is not calibrated: its"),
        (instant(depth(wall(2.0)), COLOR, COARSE), "of depth calibrated for 32x24 pixels, the image has 64x48"),
        (instant(depth(wall(2.0)), COARSE, COLOR), "of colour calibrated for 32x24"),
        (
            instant(depth(wall(2.0), frame_id="other"), COLOR, COLOR, "nothing is known of frame 'other'"),
            "frame 'other'",
        ),
        (
            instant(
                depth(wall(2.0)[:24, :32]), msgspec.structs.replace(COLOR, distortion_model="odd", d=[0.1]), COARSE
            ),
            "of colour unknown distortion model 'odd'",
        ),
    ],
)
def test_why_depth_cannot_be_brought_to_the_image(seen: Instant, reason: str) -> None:
    with pytest.raises(GeometryError, match=reason):
        Views(DepthLimits()).view(seen)


def test_a_calibration_of_another_picture_leaves_depth_of_the_same_camera_readable() -> None:
    image, camera = Views(DepthLimits()).view(instant(depth(wall(2.0)), COARSE, None))
    assert (image.metres() == 2).all()
    assert camera == "calibrated for 32x24 pixels, the image has 64x48"


def test_limits_and_what_is_no_depth() -> None:
    sent = depth(np.where(np.arange(64) < 32, wall(0.5), wall(6.0)))
    image, _ = Views(DepthLimits(nearest_m=1.0, farthest_m=5.0)).view(instant(sent, COLOR, None))
    assert np.isnan(image.metres()).all()
    grey = msgspec.structs.replace(sent, encoding="mono16")
    with pytest.raises(DepthError, match="mono16"):
        Views(DepthLimits()).view(instant(grey, COLOR, None))
