from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from services.geometry.foreground import SUPPORT, Foreground, foreground

RNG = np.random.default_rng(3)


def seen(*surfaces: tuple[float, int], noise: float = 0.005) -> NDArray[Any]:
    return np.sort(np.concatenate([RNG.normal(z, noise, count) for z, count in surfaces]))


def test_one_surface_is_all_of_it() -> None:
    depths = seen((2.0, 1000))
    assert foreground(depths) == Foreground(depths[0], depths[-1])


def test_background_through_gaps_is_left_out_even_where_there_is_more_of_it() -> None:
    found = foreground(seen((2.0, 400), (4.0, 600)))
    assert found.nearest_m == pytest.approx(2, abs=0.05)
    assert found.farthest_m == pytest.approx(2, abs=0.05)


def test_a_little_in_front_is_not_the_object() -> None:
    found = foreground(seen((1.0, 200), (2.0, 800)))
    assert found.nearest_m == pytest.approx(2, abs=0.05)
    enough = foreground(seen((1.0, int(SUPPORT * 1000) + 10), (2.0, 700)))
    assert enough.nearest_m == pytest.approx(1, abs=0.05)


def test_a_deep_object_is_kept_whole() -> None:
    depths = np.linspace(2.0, 3.5, 2000)
    assert foreground(depths) == Foreground(2.0, 3.5)


def test_flying_pixels_do_not_bridge_to_the_background() -> None:
    depths = np.sort(np.concatenate([seen((2.0, 900), (5.0, 300)), RNG.uniform(2, 5, 60)]))
    assert foreground(depths).farthest_m < 2.2


@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_few_readings(count: int) -> None:
    assert foreground(np.full(count, 1.5)) == Foreground(1.5, 1.5)


def test_readings_that_form_no_surface_are_all_of_it() -> None:
    assert foreground(np.array([1.0, 3.0, 9.0])) == Foreground(1.0, 9.0)
