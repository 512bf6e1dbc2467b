import cv2
import numpy as np
import pytest

from services.geometry.distortion import Brown, Equidistant, Straight, distortion_of
from services.geometry.errors import CalibrationError
from tests.services.geometry.cameras import EQUIDISTANT, PLUMB_BOB, PRISM, RATIONAL

SOME = np.random.default_rng(5).uniform(-0.7, 0.7, (50, 2))
HOMOGENEOUS = np.column_stack([SOME, np.ones(len(SOME))])[:, np.newaxis]
NOWHERE, IDENTITY = np.zeros(3), np.identity(3)


@pytest.mark.parametrize("lens", [PLUMB_BOB, RATIONAL, PRISM])
def test_lenses_bend_as_opencv_has_them(lens: tuple[str, list[float]]) -> None:
    theirs, _ = cv2.projectPoints(HOMOGENEOUS, NOWHERE, NOWHERE, IDENTITY, np.array(lens[1]))
    ours = np.stack(distortion_of(*lens).distort(*SOME.T), axis=1)
    assert ours == pytest.approx(theirs[:, 0], abs=1e-9)


def test_a_fisheye_bends_as_opencv_has_it() -> None:
    theirs, _ = cv2.fisheye.projectPoints(HOMOGENEOUS, NOWHERE, NOWHERE, IDENTITY, np.array(EQUIDISTANT[1]))
    ours = np.stack(distortion_of(*EQUIDISTANT).distort(*SOME.T), axis=1)
    assert ours == pytest.approx(theirs[:, 0], abs=1e-9)


def test_the_axis_stays_where_it_is() -> None:
    zero = np.zeros(1)
    for lens in (PLUMB_BOB, RATIONAL, EQUIDISTANT):
        made = distortion_of(*lens)
        for x, y in (made.distort(zero, zero), made.undistort(zero, zero)):
            assert (x[0], y[0]) == (0, 0)


def test_a_lens_is_made_once_for_as_long_as_it_is_the_same() -> None:
    model, d = PLUMB_BOB
    assert distortion_of(model, d) is distortion_of(model, tuple(d))
    assert distortion_of(model, [2 * number for number in d]) != distortion_of(model, d)


@pytest.mark.parametrize("d", [[], [0.0] * 5, [0.0] * 3])
@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial", "", "none", "None", "Plumb Bob"])
def test_no_coefficients_that_bend_are_a_straight_lens(model: str, d: list[float]) -> None:
    assert isinstance(distortion_of(model, d), Straight)


@pytest.mark.parametrize("d", [[], [0.0] * 4, [0.0] * 5])
def test_an_equidistant_lens_without_coefficients_is_a_fisheye_all_the_same(d: list[float]) -> None:
    lens = distortion_of("equidistant", d)
    assert lens.distort(np.ones(1), np.zeros(1))[0] == pytest.approx(np.pi / 4)


@pytest.mark.parametrize("lens", [PLUMB_BOB, RATIONAL, PRISM, EQUIDISTANT])
@pytest.mark.parametrize("more", [1, 3, 18])
def test_noughts_behind_the_coefficients_change_nothing(lens: tuple[str, list[float]], more: int) -> None:
    model, d = lens
    assert distortion_of(model, d + [0.0] * more) == distortion_of(model, d)


def test_a_point_past_where_the_model_folds_back_is_nowhere() -> None:
    lens = distortion_of("plumb_bob", [-0.3, 0, 0, 0, 0])
    assert isinstance(lens, Brown)
    assert lens.widest == pytest.approx(1 / np.sqrt(0.9), abs=0.02)
    x = np.array([0.5, 1.0, 1.2])
    assert np.isnan(lens.distort(x, np.zeros(3))[0]).tolist() == [False, False, True]


def test_a_pixel_that_no_light_can_reach_looks_nowhere() -> None:
    lens = distortion_of("plumb_bob", [-0.3, 0, 0, 0, 0])
    x, _ = lens.undistort(np.array([0.1, 0.9]), np.zeros(2))
    assert np.isnan(x).tolist() == [False, True]
    fish = distortion_of("fisheye", [0.0] * 4)
    assert isinstance(fish, Equidistant)
    x, _ = fish.undistort(np.array([0.1, 1.6]), np.zeros(2))
    assert np.isnan(x).tolist() == [False, True]


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", [0.5, -0.3, 0.001, -0.002, 0.0]),
        ("rational_polynomial", [0.5, -0.3, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0]),
        ("equidistant", [0.5, -0.3, 0.0, 0.0]),
    ],
)
def test_where_a_lens_spreads_and_then_folds_back_every_pixel_looks_somewhere(model: str, d: list[float]) -> None:
    lens = distortion_of(model, d)
    assert isinstance(lens, Brown | Equidistant)
    most = lens.widest if isinstance(lens, Brown) else np.tan(lens.widest)
    radii, around = np.meshgrid(np.linspace(0, 0.95 * most, 60), np.linspace(0, 2 * np.pi, 30))
    x, y = radii * np.cos(around), radii * np.sin(around)
    found_x, found_y = lens.undistort(*lens.distort(x, y))
    assert found_x == pytest.approx(x, abs=1e-5)
    assert found_y == pytest.approx(y, abs=1e-5)


@pytest.mark.parametrize(
    ("model", "d", "reason"),
    [
        ("ftheta", [0.1], "unknown distortion model 'ftheta'"),
        ("", [0.1], "unknown distortion model ''"),
        ("plumb_bob", [0.1, 0.2, 0.3], "3 coefficients for distortion model 'plumb_bob', which has 4 or 5"),
        ("plumb_bob", [0.1] * 8, "8 coefficients for distortion model 'plumb_bob', which has 4 or 5"),
        ("equidistant", [0.1], "1 coefficients for distortion model 'equidistant', which has 4"),
        ("equidistant", [0.1] * 5, "5 coefficients for distortion model 'equidistant', which has 4"),
        ("plumb_bob", [float("nan")] * 5, "not finite"),
        ("rational_polynomial", [0.1] * 14, "a tilted sensor"),
    ],
)
def test_what_is_no_lens_that_is_known(model: str, d: list[float], reason: str) -> None:
    with pytest.raises(CalibrationError, match=reason):
        distortion_of(model, d)
