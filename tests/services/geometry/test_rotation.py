from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from services.geometry.rotation import inverse_of, level_directions, matrix_of, quaternion_of, slerp

numbers = st.floats(-1, 1)
quaternions = st.tuples(numbers, numbers, numbers, numbers).map(np.array).filter(lambda q: np.linalg.norm(q) > 0.1)
NOWHERE = np.zeros(3)


@given(quaternion=quaternions)
def test_a_quaternion_survives_being_a_matrix(quaternion: NDArray[Any]) -> None:
    unit = quaternion / np.linalg.norm(quaternion)
    again = quaternion_of(matrix_of(NOWHERE, unit))
    assert abs(again @ unit) == pytest.approx(1)
    assert again[3] >= 0


@pytest.mark.parametrize("axis", range(3))
def test_half_turns(axis: int) -> None:
    turned = np.zeros(4)
    turned[axis] = 1
    matrix = matrix_of(NOWHERE, turned)
    assert np.diag(matrix)[:3].tolist() == [1 if each == axis else -1 for each in range(3)]
    assert abs(quaternion_of(matrix) @ turned) == pytest.approx(1)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    matrix = matrix_of(np.array([1.0, 2, 3]), np.array([0, 0, np.sqrt(0.5), np.sqrt(0.5)]))
    assert matrix @ (1, 0, 0, 1) == pytest.approx(np.array([1, 3, 3, 1]))
    assert inverse_of(matrix) @ matrix == pytest.approx(np.identity(4))


@given(start=quaternions, end=quaternions, share=st.floats(0, 1))
def test_on_the_way_the_turn_grows_evenly(start: NDArray[Any], end: NDArray[Any], share: float) -> None:
    first, last = start / np.linalg.norm(start), end / np.linalg.norm(end)
    whole = np.arccos(min(1.0, abs(first @ last)))
    part = np.arccos(min(1.0, abs(first @ slerp(first, last, share))))
    assert part == pytest.approx(share * whole, abs=1e-4)


def test_level_directions_go_round_from_x_to_y() -> None:
    assert level_directions(4) == pytest.approx(np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]))
    assert np.linalg.norm(level_directions(12), axis=1) == pytest.approx(np.ones(12))
