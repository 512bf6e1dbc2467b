import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as coco

from services.detector.runtime.masks import MANY_PIXELS, encode_all
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
