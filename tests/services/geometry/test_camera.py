import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.camera_info import Region
from services.geometry.camera import CameraModel
from services.geometry.errors import CalibrationError
from tests.services.geometry.cameras import LENSES, camera, info


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_a_point_seen_is_where_its_pixel_looks(lens: tuple[str, list[float]]) -> None:
    seen = camera(lens=lens)

    @given(x=st.floats(-0.7, 0.7), y=st.floats(-0.6, 0.6), z=st.floats(0.1, 50))
    def round_trip(x: float, y: float, z: float) -> None:
        point = np.array([[x * z, y * z, z]])
        assert seen.unproject(seen.project(point), [z]) == pytest.approx(point, abs=1e-6 * z)

    round_trip()


def test_a_straight_camera_by_hand() -> None:
    seen = camera()
    assert seen.project([[0, 0, 2], [1, -0.5, 2]]) == pytest.approx(np.array([[31.5, 23.5], [56.5, 11.0]]))
    assert seen.unproject([[56.5, 11.0]], [2]) == pytest.approx(np.array([[1, -0.5, 2]]))


def test_skew_shifts_columns_by_rows() -> None:
    k = [50, 10, 31.5, 0, 50, 23.5, 0, 0, 1]
    seen = CameraModel.of(msgspec.structs.replace(info(), k=k))
    assert seen.project([[1, 1, 2]]) == pytest.approx(np.array([[31.5 + 25 + 5, 48.5]]))
    assert seen.unproject(seen.project([[1, 1, 2]]), [2]) == pytest.approx(np.array([[1, 1, 2]]))


def test_what_is_not_before_the_camera_has_no_pixel() -> None:
    assert np.isnan(camera().project([[0, 0, 0], [1, 1, -1], [0, 0, np.nan]])).all()


def test_rays_are_those_of_the_pixels_and_made_once() -> None:
    seen = camera(lens=LENSES["plumb_bob"])
    rays = seen.rays()
    assert rays.shape == (2, 48, 64)
    assert rays[:, 7, 9] == pytest.approx(seen.undistort([[9, 7]])[0], abs=1e-6)
    assert seen.rays() is rays
    with pytest.raises(ValueError, match="read-only"):
        rays[0, 0, 0] = 1


def test_rays_of_single_pixels_are_the_same_whether_or_not_all_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = camera(lens=LENSES["plumb_bob"])
    pixels = np.array([[0, 7 * 64 + 9], [48 * 64 - 1, 100]])
    kept = seen.rays_of(pixels)
    monkeypatch.setattr("services.geometry.camera.KEPT_PIXELS", 48 * 64 - 1)
    large = camera(lens=LENSES["plumb_bob"])
    assert np.array_equal(kept, large.rays_of(pixels))
    assert np.array_equal(kept, large.rays().reshape(2, -1)[:, pixels])


def test_pictures_of_another_size_are_not_this_cameras() -> None:
    with pytest.raises(CalibrationError, match="calibrated for 64x48 pixels, the image has 32x24"):
        camera().check_size(24, 32)


def test_a_region_and_binning_are_what_the_picture_is_cut_and_shrunk_to() -> None:
    region = Region(x_offset=16, y_offset=8, width=32, height=24)
    whole, part = camera(), CameraModel.of(info(roi=region, binning=2))
    assert (part.height, part.width) == (12, 16)
    assert part.project([[0.1, -0.2, 2]]) == pytest.approx((whole.project([[0.1, -0.2, 2]]) - (16, 8)) / 2)


@pytest.mark.parametrize(
    ("k", "reason"),
    [
        ([0] * 9, "not calibrated"),
        ([50, 0, 1, 0, -50, 1, 0, 0, 1], "not calibrated"),
        ([50, 0, 1, 0, float("nan"), 1, 0, 0, 1], "not calibrated"),
        ([50, 0, 1, 0, 50, 1, 0, 0, 2], "not calibrated"),
        ([50, 0, 1, 0, 1e-300, 1, 0, 0, 1], "not calibrated"),
        ([1e300, 0, 1, 0, 50, 1, 0, 0, 1], "not calibrated"),
    ],
)
def test_a_camera_that_is_not_calibrated(k: list[float], reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason):
        CameraModel.of(msgspec.structs.replace(info(), k=k))


def test_a_picture_too_large_to_place() -> None:
    vast = CameraModel.of(info(height=2**31, width=2**31))
    with pytest.raises(CalibrationError, match="at most"):
        vast.rays()
