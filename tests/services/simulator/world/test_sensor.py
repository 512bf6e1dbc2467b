import numpy as np
import pytest

from services.simulator.world import Sensor, expose

GREY = np.full((48, 64, 3), 60, np.uint8)
PLAIN = Sensor(mean_level=118, vignette=0, noise=0)


def test_exposure_brings_the_mean_to_its_level() -> None:
    assert expose(GREY, PLAIN, np.random.default_rng(0)).mean() == pytest.approx(118, abs=1)


def test_the_same_seed_gives_the_same_noise_and_another_does_not() -> None:
    one, same, other = (expose(GREY, Sensor(), np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("noise", [2.0, 8.0])
def test_noise_is_as_strong_as_asked_for(noise: float) -> None:
    image = expose(GREY, Sensor(vignette=0, noise=noise), np.random.default_rng(0))
    assert image.std() == pytest.approx(noise, rel=0.15)


def test_the_picture_given_is_left_alone() -> None:
    before = GREY.copy()
    assert expose(GREY, Sensor(motion=5), np.random.default_rng(0)).shape == GREY.shape
    assert np.array_equal(before, GREY)


def test_vignetting_darkens_the_corners() -> None:
    image = expose(GREY, Sensor(vignette=0.5, noise=0), np.random.default_rng(0))
    assert int(image[24, 32, 0]) - int(image[0, 0, 0]) > 40


def test_black_stays_black() -> None:
    assert expose(np.zeros_like(GREY), PLAIN, np.random.default_rng(0)).max() == 0


def test_motion_blur_smears_along_the_row() -> None:
    edge = GREY.copy()
    edge[:, 32:] = 200
    sharp, smeared = (expose(edge, Sensor(vignette=0, noise=0, motion=n), np.random.default_rng(0)) for n in (1, 7))
    assert np.abs(np.diff(smeared[20, :, 0].astype(int))).max() < np.abs(np.diff(sharp[20, :, 0].astype(int))).max()


@pytest.mark.parametrize("seed", range(20))
def test_any_camera_drawn_gives_a_usable_picture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = expose(GREY, Sensor.draw(rng), rng)
    assert 40 < image.mean() < 200
