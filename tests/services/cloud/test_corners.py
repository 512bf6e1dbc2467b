"""Two upright faces before a camera, seen exactly: the corner between them is nearest."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from services.cloud.corners import SPLITS, forms_of, moments_of_runs, pair_of, refined, shares_of, single_of

SIDEWAYS = np.linspace(-0.5, 0.5, 120)
"""From right to left, ahead being 1."""

CORNER = 0.5 * np.minimum(1 + SIDEWAYS, 1 - SIDEWAYS)
WALL = 0.4 + 0.1 * SIDEWAYS


def products(inverse: NDArray[Any]) -> NDArray[Any]:
    ahead = np.ones_like(SIDEWAYS)
    each = [ahead, SIDEWAYS, SIDEWAYS**2, inverse, SIDEWAYS * inverse]
    return np.stack(each, axis=1)[np.newaxis].astype(np.float32)


def moments(inverse: NDArray[Any], weights: NDArray[Any] | None = None) -> NDArray[Any]:
    """Return the moments (5, 1, SPLITS) of runs of readings."""
    weights = np.ones(len(inverse)) if weights is None else weights
    return moments_of_runs(weights[None, None].astype(np.float32), shares_of(products(inverse)))


def test_runs_have_all_readings_between_them_each_once() -> None:
    sums = moments(CORNER)
    assert sums.shape == (5, 1, SPLITS)
    assert sums[0, 0].tolist() == [len(CORNER) / SPLITS] * SPLITS
    assert sums.sum(axis=2)[:, 0] == pytest.approx(products(CORNER)[0].sum(axis=0), abs=1e-4)


@pytest.mark.parametrize("count", [1, 7, 11])
def test_of_few_readings_each_is_in_a_run(count: int) -> None:
    shares = shares_of(np.ones((1, count, 5), np.float32))
    assert shares.reshape(count, 5, SPLITS).sum(axis=2).tolist() == [[1] * 5] * count


def test_both_faces_of_a_corner_are_found() -> None:
    ((angle, right, left),) = pair_of(moments(CORNER))
    assert angle == pytest.approx(-np.pi / 4, abs=0.05)
    assert (right, left) == (pytest.approx(0.5**0.5, rel=0.05), pytest.approx(0.5**0.5, rel=0.05))


def test_one_face_is_found_exactly() -> None:
    pair = single_of(moments(WALL).sum(axis=2))
    assert np.isnan(pair[0, 1])
    assert forms_of(pair, np.array([np.nan]))[0, 0] == pytest.approx([0.4, 0.1, 0], abs=1e-4)


def test_faces_are_turned_to_where_their_readings_are() -> None:
    askew = forms_of(np.array([[-np.pi / 4 + 0.1, 0.7, 0.7]]), np.array([-1.0]))
    sides = [moments(CORNER, side).sum(axis=2) for side in (SIDEWAYS > 0, SIDEWAYS < 0)]
    (made,) = refined(askew, *sides)
    assert made[0] == pytest.approx([0.5, -0.5, 0], abs=0.02)
    assert made[1] == pytest.approx([0.5, 0.5, 0], abs=0.02)
    assert made[2].tolist() == [0, 0, -1]
