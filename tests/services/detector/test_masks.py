import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from pycocotools import mask as coco

from services.detector.masks import encode_window


@st.composite
def windows(draw: st.DrawFn) -> tuple[NDArray[np.bool_], int, int, int, int]:
    """Draw a window's columns, its place, and the size of the image around it."""
    wide, high = draw(st.integers(0, 9)), draw(st.integers(0, 9))
    top, left, below, right = (draw(st.integers(0, 4)) for _ in range(4))
    columns = draw(arrays(np.bool_, (wide, high)))
    return columns, top, left, max(1, top + high + below), max(1, left + wide + right)


@given(windows())
def test_a_window_is_encoded_as_pycocotools_encodes_the_whole_image(
    window: tuple[NDArray[np.bool_], int, int, int, int],
) -> None:
    columns, top, left, height, width = window
    whole = np.zeros((height, width), np.uint8)
    whole[top : top + columns.shape[1], left : left + columns.shape[0]] = columns.T
    expected = coco.encode(np.asfortranarray(whole))
    mask = encode_window(columns, top, left, height, width)
    assert (mask.size, mask.counts) == ((height, width), expected["counts"].decode("ascii"))


def test_long_runs_of_large_images_too() -> None:
    height, width = 16_384, 3_000
    columns = np.ones((2, 5), np.bool_)
    whole = np.zeros((height, width), np.uint8, order="F")
    whole[16_379:, 2_998:] = 1
    assert encode_window(columns, 16_379, 2_998, height, width).counts == coco.encode(whole)["counts"].decode("ascii")
