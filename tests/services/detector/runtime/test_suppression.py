import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from services.detector.runtime.candidates import BLOCK, suppressed

IOU = 0.5


def one_by_one(corners: NDArray[np.float32], labels: NDArray[np.int64], most: int) -> list[int]:
    """Keep whatever overlaps nothing kept too much, by the definition."""
    kept: list[int] = []
    for n, (left, top, right, bottom) in enumerate(corners.tolist()):
        for m in kept:
            x1, y1, x2, y2 = corners[m].tolist()
            shared = max(0, min(right, x2) - max(left, x1)) * max(0, min(bottom, y2) - max(top, y1))
            either = (right - left) * (bottom - top) + (x2 - x1) * (y2 - y1) - shared
            if labels[m] == labels[n] and shared > IOU * either:
                break
        else:
            kept.append(n)
    return kept[:most]


@given(arrays(np.int8, st.tuples(st.integers(0, 30), st.just(5)), elements=st.integers(0, 9)), st.integers(1, 30))
def test_what_is_kept_overlaps_nothing_better_of_its_class_too_much(numbers: NDArray[np.int8], most: int) -> None:
    begins, sizes, labels = numbers[:, :2], numbers[:, 2:4], numbers[:, 4] % 2
    corners = np.concatenate([begins, begins + sizes], axis=1).astype(np.float32)
    expected = one_by_one(corners, labels.astype(np.int64), most)
    assert suppressed(corners, labels.astype(np.int64), IOU, most).tolist() == expected


@pytest.mark.parametrize("count", [BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK + 1])
def test_more_than_are_compared_at_once(count: int) -> None:
    lefts = np.tile(np.arange(0, 40, 4), count)[:count]
    corners = np.stack([lefts, np.zeros(count), lefts + 4, np.ones(count)], axis=1).astype(np.float32)
    labels = np.zeros(count, np.int64)
    labels[-1] = 1
    assert suppressed(corners, labels, IOU, 300).tolist() == [*range(10), count - 1]
    assert suppressed(corners, labels, IOU, 7).tolist() == list(range(7))
