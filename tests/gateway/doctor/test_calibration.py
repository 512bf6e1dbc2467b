import pytest

from gateway.doctor.cameras import check_cameras
from gateway.doctor.evidence import Heard, StreamLook
from gateway.doctor.finding import Finding, Severity
from schemas.camera_info import Region
from tests.gateway.doctor.seeing import INFO, color, color_info, depth, depth_info, evidence, publisher, sends, stream


def said(
    subject: str, *streams: StreamLook, beside: tuple[StreamLook, ...] = (), discover: bool = True
) -> list[Finding]:
    seen = evidence(*streams, beside=beside, discover=discover)
    return [each for each in check_cameras(seen) if each.subject == subject]


def test_a_calibrated_camera_needs_no_word() -> None:
    assert said("front/info", color(), color_info()) == []


def test_colour_alone_needs_no_calibration() -> None:
    assert said("front/info", color()) == []


def test_a_lidar_has_no_calibration() -> None:
    assert said("velodyne/info", sends("velodyne/points", "/velodyne_points", "sensor_msgs/PointCloud2")) == []


def test_depth_without_any_camera_info() -> None:
    (finding,) = said("front/info", color(), depth())
    assert finding.severity is Severity.NOTE
    assert finding.what.startswith("no camera info: ")


def test_a_camera_info_that_does_not_come() -> None:
    mute = stream("front/info", "/front/color/camera_info", INFO, publisher(INFO, Heard()))
    (finding,) = said("front/info", color(), mute)
    assert finding.severity is Severity.PROBLEM
    assert finding.what == "no camera info came from /front/color/camera_info"


@pytest.mark.parametrize("f", [0.0, -1.0, float("nan")])
def test_a_camera_without_focal_length(f: float) -> None:
    (finding,) = said("front/info", color(), color_info(f=f, width=0, height=0))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == (
        "the camera info has no focal length: the camera is not calibrated, so its pixels cannot be "
        "projected into space"
    )


def test_a_depth_camera_without_focal_length() -> None:
    (finding,) = said("front/depth_info", color(), depth(), depth_info(f=0.0))
    assert "no focal length" in finding.what
    assert "image:=/front/depth/image_raw camera:=/front/depth" in finding.advice


@pytest.mark.parametrize(
    ("model", "d", "reason"),
    [
        ("ftheta", [0.1], "unknown distortion model 'ftheta'"),
        ("equidistant", [0.1] * 5, "5 coefficients for distortion model 'equidistant', which has 4"),
    ],
)
def test_a_lens_that_nobody_here_knows(model: str, d: list[float], reason: str) -> None:
    (finding,) = said("front/info", color(), color_info(distortion_model=model, d=d))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == f"{reason}: the camera's pixels cannot be projected into space"


@pytest.mark.parametrize(("model", "d"), [("equidistant", [0.1] * 4 + [0.0]), ("none", []), ("Plumb Bob", [0.0] * 5)])
def test_a_lens_whose_coefficients_are_written_another_way(model: str, d: list[float]) -> None:
    assert said("front/info", color(), color_info(distortion_model=model, d=d)) == []


def test_a_calibration_that_is_there_but_no_stream() -> None:
    (finding,) = said("front/info", color(), depth(), beside=(color_info(),), discover=False)
    assert finding.severity is Severity.NOTE
    assert finding.advice == "add --topics front/info=/front/color/camera_info"


def test_a_calibration_of_another_resolution() -> None:
    (finding,) = said("front/info", color(), color_info(width=16, height=8))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == "the camera info is for 16x8 pixels, color has 8x4"


@pytest.mark.parametrize(
    ("cx", "cy", "where"),
    [
        (8.5, 2.0, "(8, 2) is outside of 8x4 pixels"),
        (4.0, -3.0, "(4, -3) is outside of 8x4 pixels"),
        (6.8, 2.0, "(7, 2) is far off the centre of 8x4 pixels"),
        (0.0, 0.0, "(0, 0) is far off the centre of 8x4 pixels"),
        (6.6, 3.3, ""),
        (1.4, 0.7, ""),
    ],
)
def test_a_principal_point_that_no_lens_of_the_picture_has(cx: float, cy: float, where: str) -> None:
    found = said("front/info", color(), color_info(k=[6.0, 0, cx, 0, 6.0, cy, 0, 0, 1]))
    assert [each.severity for each in found] == [Severity.PROBLEM] * bool(where)
    assert all(each.what.endswith(f"its principal point {where}") for each in found)


def test_a_principal_point_is_one_of_the_full_picture() -> None:
    """ROS keeps the full picture's calibration where a region of it is sent."""
    corner = Region(x_offset=8, y_offset=4, width=8, height=4)
    assert said("front/info", color(), color_info(width=16, height=8, roi=corner)) == []


def test_a_calibration_without_a_size_is_that_of_the_image() -> None:
    found = said("front/info", color(), color_info(width=0, height=0, k=[6.0, 0, 40.0, 0, 6.0, 2.0, 0, 0, 1]))
    assert "outside of 8x4 pixels" in found[0].what


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 16, "height": 8, "binning_x": 2, "binning_y": 2},
        {"width": 16, "height": 8, "roi": Region(x_offset=1, y_offset=1, width=8, height=4)},
        {"width": 32, "height": 16, "binning_x": 2, "binning_y": 2, "roi": Region(width=16, height=8)},
        {"width": 8, "height": 4, "binning_x": 1, "roi": Region(x_offset=3)},
    ],
)
def test_binning_and_region_make_the_size(changes: dict[str, object]) -> None:
    assert said("front/info", color(), color_info(**changes)) == []
