"""The height of the floor that cameras show, learned from their views."""

import numpy as np

from services.worldmodel.floor_levels import FloorLevels


def test_a_floor_that_was_deep_for_long_comes_back() -> None:
    floors, one = FloorLevels(), np.zeros(1, np.intp)
    for level, views, known_m in (
        (0.0, 1, 0.0),
        (-3.0, 20, -3.0),
        (np.nan, 9, -3.0),
        (-np.inf, 9, -3.0),
        (0.1, 5, 0.1),
    ):
        for _ in range(views):
            floors.learn(one, np.array([level]))
        assert floors.known.tolist() == [known_m]


def test_a_floor_is_not_known_before_a_view_fits() -> None:
    floors, one = FloorLevels(), np.zeros(1, np.intp)
    for level in (0.0, -9.0, np.inf):
        assert [each.tolist() for each in floors.compare(one, np.array([level]))] == [[False], [False]]
