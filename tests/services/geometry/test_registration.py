from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from services.geometry.errors import CalibrationError
from services.geometry.registration import Registration, is_registered
from services.geometry.rotation import matrix_of
from tests.services.geometry.cameras import LENSES, camera

HERE = np.identity(4)


def shifted(x: float) -> NDArray[Any]:
    made = np.identity(4)
    made[0, 3] = x
    return made


def wall(z: float, height: int = 48, width: int = 64) -> NDArray[Any]:
    return np.full((height, width), z, np.float32)


@pytest.mark.parametrize("size", [(48, 64), (333, 200)])
def test_the_same_camera_sees_the_same(size: tuple[int, int]) -> None:
    depth = np.random.default_rng(1).uniform(1, 5, size).astype(np.float32)
    depth[3, 4] = np.nan
    same = camera(height=size[0], width=size[1])
    seen = Registration(same, same, HERE).apply(depth)
    assert np.array_equal(seen, depth, equal_nan=True)


def test_a_wall_seen_from_beside_is_shifted_by_its_disparity() -> None:
    seen = Registration(camera(), camera(), shifted(-0.4)).apply(wall(2.0))
    assert np.isnan(seen[:, -10:]).all()
    assert (seen[:, :-10] == 2).all()


def test_what_is_nearer_hides_what_is_behind() -> None:
    depth = wall(4.0)
    depth[:, 30:40] = 1.0
    seen = Registration(camera(), camera(), shifted(-0.2)).apply(depth)
    assert (seen[:, 20:30] == 1).all()  # moved by 10 pixels, the wall by 2 and a half
    assert not (seen[:, :20] == 1).any()
    assert np.isnan(seen[:, 30:37]).all()  # what only depth's camera cannot see, behind the near one


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_a_finer_camera_with_a_lens_has_no_holes(lens: tuple[str, list[float]]) -> None:
    coarse, fine = camera(), camera(height=96, width=128, focal=130.0, lens=lens)
    seen = Registration(coarse, fine, shifted(0.02)).apply(wall(3.0))
    assert not np.isnan(seen[10:-10, 10:-10]).any()
    assert np.nanmax(np.abs(seen - 3)) == 0


@pytest.mark.parametrize("focal", [160.0, 260.0])
def test_a_finer_camera_that_sees_less_is_told_depth_up_to_every_border(focal: float) -> None:
    fine = camera(height=144, width=192, focal=focal)
    assert not np.isnan(Registration(camera(), fine, HERE).apply(wall(2.0))).any()


def test_depth_becomes_that_along_the_other_axis() -> None:
    turned = matrix_of(np.zeros(3), np.array([0, np.sin(0.1), 0, np.cos(0.1)]))
    seen = Registration(camera(), camera(), turned).apply(wall(2.0))
    ray = np.array([0, 0, 2.0])
    pixel = np.rint(camera().project([turned[:3, :3] @ ray])[0]).astype(int)
    assert seen[pixel[1], pixel[0]] == pytest.approx(2 * np.cos(0.2), abs=0.02)


def test_what_is_behind_the_other_camera_is_not_seen() -> None:
    behind = np.identity(4)
    behind[2, 3] = -5
    assert np.isnan(Registration(camera(), camera(), behind).apply(wall(2.0))).all()


def test_another_size_than_calibrated() -> None:
    with pytest.raises(CalibrationError, match="calibrated for 64x48"):
        Registration(camera(), camera(), HERE).apply(wall(2.0, 24, 32))


def test_what_counts_as_registered_already() -> None:
    assert is_registered(camera(), camera(), HERE)
    assert is_registered(camera(), camera(focal=50.5), HERE)
    assert not is_registered(camera(), camera(focal=51.0), HERE)
    assert not is_registered(camera(), camera(), shifted(0.001))
    assert not is_registered(camera(), camera(height=96, width=128, focal=100), HERE)
    assert not is_registered(camera(), camera(lens=LENSES["fish"]), HERE)
    assert is_registered(camera(lens=LENSES["fish"]), camera(lens=LENSES["fish"]), HERE)


def test_a_lens_that_sees_nothing_in_the_corners_is_registered_to_itself() -> None:
    circle = camera(focal=20.0, lens=LENSES["fish"])
    assert np.isnan(circle.rays()[0, 0, 0])
    assert is_registered(circle, circle, HERE)
    assert not is_registered(circle, camera(focal=20.5, lens=LENSES["fish"]), HERE)
    assert not is_registered(camera(focal=20.0), circle, HERE)
