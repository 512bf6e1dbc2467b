import numpy as np
import pytest

from services.detector.runtime.letterbox import Axis
from services.detector.runtime.masks import Taps


@pytest.mark.parametrize("axis", [Axis(640, 640, 0, 640), Axis(90, 60, 2, 64), Axis(3, 64, 0, 64), Axis(1, 1, 31, 64)])
def test_pixels_are_between_the_places_that_their_middles_are_between(axis: Axis) -> None:
    size = axis.input // 4
    places = np.arange(size, dtype=np.float32)[:, None] ** 2
    low, content = axis.before / 4, axis.content / 4
    middles = low + (np.arange(axis.image) + 0.5) * content / axis.image - 0.5
    inside = np.clip(middles, low, min(max(low, low + content - 1), size - 1))
    expected = np.interp(inside, np.arange(size), places[:, 0])
    assert np.allclose(Taps.of(axis, size).apply(places)[:, 0], expected, rtol=1e-5, atol=1e-3)


def test_some_pixels_are_interpolated_as_among_all() -> None:
    places = np.random.default_rng(1).random((16, 3), np.float32)
    taps = Taps.of(Axis(100, 60, 2, 64), 16)
    for begin, end in [(0, 100), (0, 1), (99, 100), (37, 61)]:
        where, some = taps.cut(begin, end)
        assert np.array_equal(some.apply(places[where]), taps.apply(places)[begin:end])


def test_no_pixels_need_a_place_all_the_same() -> None:
    where, none = Taps.of(Axis(100, 64, 0, 64), 16).cut(40, 40)
    assert none.apply(np.ones((16, 3), np.float32)[where]).shape == (0, 3)


@pytest.mark.parametrize(
    ("axis", "first", "last", "begin", "count"),
    [
        (Axis(640, 640, 0, 640), 40, 72, 40, 32),
        (Axis(320, 640, 0, 640), 40, 72, 20, 16),
        (Axis(1280, 640, 0, 640), 40, 72, 80, 64),
        (Axis(90, 60, 2, 64), 0, 64, 0, 90),  # the padding is no part of the image
        (Axis(90, 60, 2, 64), 60, 64, 87, 3),
        (Axis(90, 60, 2, 64), 62, 64, 90, 0),
        (Axis(90, 60, 2, 64), 0, 2, 0, 0),
    ],
)
def test_the_pixels_of_a_window_are_those_whose_middles_are_in_it(
    axis: Axis, first: int, last: int, begin: int, count: int
) -> None:
    size = 8
    places = np.linspace(first, last, 2 * size + 1, dtype=np.float32)[1::2, None]  # where each is
    found, taps = Taps.within(axis, first, last, size)
    assert (found, len(taps.before)) == (begin, count)
    middles = (np.arange(begin, begin + count) + 0.5) * axis.content / axis.image + axis.before
    assert np.allclose(taps.apply(places)[:, 0], np.clip(middles, places[0], places[-1]), atol=1e-3)
