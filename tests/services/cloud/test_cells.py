import numpy as np
import pytest

from services.cloud.cells import CELLS, READINGS, Seen, cells_of
from services.cloud.outlines import Masked
from services.geometry.masks import Window
from tests.services.cloud.scenes import WIDTH

TOP, LEFT, FOCAL = 100, 200, 500.0


def wall(height: int, width: int, z: float = 2.0) -> Seen:
    """Return an object that is flat and faces the camera, whose axis goes through the upper left pixel."""
    rows, columns = np.divmod(np.arange(height * width), width)
    rows, columns = rows + TOP, columns + LEFT
    xyz = np.stack([columns / FOCAL * z, rows / FOCAL * z, np.full(len(rows), z)]).astype(np.float32)
    window = Window(TOP, LEFT, np.ones((height, width), np.bool_))
    return Seen(Masked(window, window), WIDTH, rows * WIDTH + columns, xyz)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (3, 200), (40, 60)])
def test_cells_have_the_mean_of_their_readings_and_count_for_all_of_the_object(height: int, width: int) -> None:
    cells = cells_of([wall(height, width), wall(2, 2, z=4.0)], np.eye(3))
    filled = cells.weights > 0
    assert cells.weights.sum(axis=1) == pytest.approx([height * width, 4])
    assert filled.sum(axis=1).max() <= min(CELLS, READINGS)
    assert np.unique(cells.inverse[0, filled[0]].round(6)).tolist() == [0.5]
    assert cells.depths == pytest.approx(np.array([[2.0, 4.0]] * 3))
    assert cells.directions[2][filled] == pytest.approx(1)


def test_where_pixels_look_follows_from_their_place_in_the_window() -> None:
    cells = cells_of([wall(40, 60)], np.eye(3))
    assert cells.places[0] @ [1, 7, 3] == pytest.approx([(LEFT + 7) / FOCAL, (TOP + 3) / FOCAL, 1], abs=1e-5)
