from typing import Any

import numpy as np
import pytest

from gateway.to_bus.stream import MALFORMED
from schemas.image import ImageFrame
from tests.gateway.sensing import STAMP_NS, disparity
from tests.gateway.to_bus.translators.translating import dropped, translated

BAD = [0.0, -1.0, np.nan, np.inf, -np.inf, 1e-44]


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 4])
def test_disparities_become_metres(padding: int, *, is_bigendian: bool) -> None:
    sent = np.array([[50.0, 25.0, 0.5]], np.float32)
    made = translated(ImageFrame, "front/depth", disparity(sent, padding=padding, is_bigendian=is_bigendian))
    assert (made.header.stamp_ns, made.header.frame_id, made.header.camera) == (STAMP_NS, "lens", "front")
    assert (made.height, made.width, made.encoding, made.step) == (1, 3, "32FC1", 12)
    assert made.is_bigendian is False
    assert np.frombuffer(made.data, "<f4").tolist() == [1.0, 2.0, 100.0]  # f = 500 pixels, T = 0.1 m


@pytest.mark.parametrize("bad", BAD)
def test_no_disparity_is_no_distance(bad: float) -> None:
    made = translated(ImageFrame, "front/depth", disparity(np.array([[bad, 50.0]], np.float32)))
    depth = np.frombuffer(made.data, "<f4")
    assert np.isnan(depth[0])
    assert depth[1] == 1.0


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_what_is_below_the_least_valid_disparity_is_no_distance(*, is_bigendian: bool) -> None:
    sent = np.array([[15.0, 15.9375, 16.0, 50.0]], np.float32)
    made = translated(ImageFrame, "front/depth", disparity(sent, min_disparity=16.0, is_bigendian=is_bigendian))
    np.testing.assert_array_equal(np.frombuffer(made.data, "<f4"), [np.nan, np.nan, 3.125, 1.0])


@pytest.mark.parametrize(("least", "depth"), [(-64.0, 1.0), (-np.inf, 1.0), (np.nan, 1.0), (np.inf, np.nan)])
def test_whatever_the_least_valid_disparity_only_one_above_0_is_a_distance(least: float, depth: float) -> None:
    sent = np.array([[-1.0, 0.0, 50.0]], np.float32)
    made = translated(ImageFrame, "front/depth", disparity(sent, min_disparity=least))
    np.testing.assert_array_equal(np.frombuffer(made.data, "<f4"), [np.nan, np.nan, depth])


@pytest.mark.parametrize(
    "changes",
    [
        {"f": 0.0},
        {"T": 0.0},
        {"T": -0.1},
        {"f": float("nan")},
        {"f": float("inf")},
        {"encoding": "mono8"},
        {"width": 3},
        {"height": 2**32 - 1},
        {"height": 0},
        {"step": 7},
    ],
    ids=str,
)
def test_what_does_not_fit_is_malformed(changes: dict[str, Any]) -> None:
    assert dropped("front/depth", disparity(np.ones((1, 2), np.float32), **changes)) == {MALFORMED: 1}
