import numpy as np

from services.simulator.world.clearance import CELLS_PER_METRE, Clearance
from services.simulator.world.drive import STRIDE, RouteMap


def walled() -> Clearance:
    """A room of 6 m x 4 m in two halves with a door at the top, and a closet that nothing leads to."""
    grid = np.full((4 * CELLS_PER_METRE, 6 * CELLS_PER_METRE), 1.0, np.float32)
    grid[: 3 * CELLS_PER_METRE, 55:65] = 0
    grid[:30, :30] = 0
    grid[4:16, 4:16] = 1
    return Clearance(grid, 3.0, 2.0)


def test_only_the_largest_area_is_free() -> None:
    free = RouteMap(walled(), 0.5).free
    assert not free[2, 2]
    assert free[-1, 0]
    assert free[0, -1]


def test_a_route_goes_around_step_by_step_through_free_cells() -> None:
    routes = RouteMap(walled(), 0.5)
    start, goal = (10, 2), (0, 29)
    route = routes.route(start, goal)
    assert (route[0], route[-1]) == (start, goal)
    assert np.abs(np.diff(route, axis=0)).max() == 1
    assert all(routes.free[cell] for cell in route)
    assert max(row for row, _ in route) * STRIDE >= 3 * CELLS_PER_METRE


def test_a_route_to_where_one_is_has_one_cell() -> None:
    assert RouteMap(walled(), 0.5).route((10, 2), (10, 2)) == [(10, 2)]


def test_no_room_means_nothing_is_free() -> None:
    assert not RouteMap(walled(), 5.0).free.any()
