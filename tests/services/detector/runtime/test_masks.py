import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as coco

from services.detector.runtime.letterbox import Axis
from services.detector.runtime.masks import MANY_PIXELS, Taps, encode_all
from services.geometry.masks import Window

HEIGHT, WIDTH = 9, 12


@st.composite
def windows(draw: st.DrawFn) -> Window:
    """Draw a window of an image of HEIGHT x WIDTH."""
    top, left = draw(st.integers(0, HEIGHT)), draw(st.integers(0, WIDTH))
    high, wide = draw(st.integers(0, HEIGHT - top)), draw(st.integers(0, WIDTH - left))
    return Window(top, left, draw(arrays(np.bool_, (high, wide))))


def by_pycocotools(window: Window, height: int, width: int) -> str:
    whole = np.zeros((height, width), np.uint8, order="F")
    whole[window.place] = window.pixels
    return str(coco.encode(whole)["counts"], "ascii")


@given(st.lists(windows(), max_size=5))
def test_windows_are_encoded_as_pycocotools_encodes_whole_images(seen: list[Window]) -> None:
    made = list(encode_all(seen, HEIGHT, WIDTH))
    assert [mask.counts for mask in made] == [by_pycocotools(window, HEIGHT, WIDTH) for window in seen]
    assert all(mask.size == (HEIGHT, WIDTH) for mask in made)


def test_long_runs_of_large_images_too() -> None:
    height, width = 16_384, 3_000
    corner = Window(height - 5, width - 2, np.ones((5, 2), np.bool_))
    assert [mask.counts for mask in encode_all([corner], height, width)] == [by_pycocotools(corner, height, width)]


def test_windows_that_are_too_large_to_be_encoded_at_once_are_all_there() -> None:
    side = 1 + int(MANY_PIXELS**0.5)
    large = Window(0, 0, np.ones((side, side), np.bool_))
    small = Window(1, 2, np.ones((3, 4), np.bool_))
    seen = [small, large, large, small]
    made = [mask.counts for mask in encode_all(seen, side, side)]
    assert made == [by_pycocotools(window, side, side) for window in seen]


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
