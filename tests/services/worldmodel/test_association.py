"""Which sighting is of which object, and which box fits an outline: against the plainest way to find them."""

from itertools import permutations

import numpy as np
import pytest

from services.worldmodel.association import GATE, _chosen
from services.worldmodel.fusion import ANGLES, LOOSE, SHAPE_M, fitted
from services.worldmodel.placement import UNITS


def cheapest(cost: dict[tuple[int, int], float], rows: list[int], columns: list[int]) -> float:
    """Return the least cost in all of one view, by trying every assignment; None stands for no object."""
    places = [*columns, *[None] * len(rows)]
    return min(
        sum(GATE if of is None else cost.get((row, of), np.inf) for row, of in zip(rows, some, strict=True))
        for some in set(permutations(places, len(rows)))
    )


@pytest.mark.parametrize("seed", range(40))
def test_each_view_takes_the_pairs_that_are_cheapest_in_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    views, pairs = [], []
    for frame in range(3):
        rows, columns = list(range(10 * frame, 10 * frame + rng.integers(1, 4))), list(range(rng.integers(1, 4)))
        cost = {(row, of): float(rng.uniform(0, GATE)) for row in rows for of in columns if rng.random() < 0.7}
        views.append((rows, columns, cost))
        pairs += [(frame, row, of, each) for (row, of), each in cost.items()]
    frame_of, row_of, of, costs = (np.array(each) for each in zip(*pairs, strict=True))
    chosen = _chosen(frame_of, row_of, of, costs)
    for frame, (rows, columns, cost) in enumerate(views):
        some = chosen[frame_of[chosen] == frame]
        assert len(set(row_of[some])) == len(set(of[some])) == len(some)
        total = costs[some].sum() + GATE * (len(rows) - len(some))
        assert total == pytest.approx(cheapest(cost, rows, columns))


def test_no_pairs_are_no_choice() -> None:
    none = np.empty(0, np.intp)
    assert not len(_chosen(none, none, none, np.empty(0)))


@pytest.mark.parametrize("seed", range(20))
def test_a_fitted_box_is_the_best_of_all_yaws_by_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    length, width, yaw, centre = 1.2, 0.8, rng.uniform(0, np.pi), rng.uniform(-50, 50, 2)
    turns = np.arctan2(UNITS[:, 1], UNITS[:, 0]) - yaw
    edges = UNITS @ centre + (length * np.abs(np.cos(turns)) + width * np.abs(np.sin(turns))) / 2
    edges += rng.normal(0, 0.02, len(UNITS))
    variance = np.where(rng.random(len(UNITS)) < 0.3, np.inf, 4e-4)
    usual, hint = np.array([1.0, 0.7, 0.3]), centre + rng.normal(0, 0.1, 2)
    found = fitted(edges[np.newaxis], variance[np.newaxis], usual[np.newaxis], hint[np.newaxis])

    known = np.isfinite(variance)
    best = np.inf, np.zeros(4), np.identity(4)
    for angle in np.arange(ANGLES) * (np.pi / 2 / ANGLES):
        turns = np.arctan2(UNITS[known, 1], UNITS[known, 0]) - angle
        sides = np.stack([np.abs(np.cos(turns)), np.abs(np.sin(turns))], axis=1) / 2
        design = np.vstack([np.hstack([UNITS[known], sides]), np.identity(4)])
        sigmas = np.sqrt(variance[known] + SHAPE_M**2)
        weights = np.concatenate([1 / sigmas, np.full(2, 1 / (LOOSE * usual[0])), np.full(2, 1 / usual[2])])
        for sizes in ((usual[0], usual[1]), (usual[1], usual[0])):
            target = np.concatenate([edges[known], hint, sizes])
            solution = np.linalg.lstsq(design * weights[:, np.newaxis], target * weights)[0]
            left = float(np.square((design @ solution - target) * weights).sum())
            if left < best[0]:
                best = left, solution, np.linalg.inv(design.T @ (design * np.square(weights)[:, np.newaxis]))
    _, solution, covariance = best
    assert found.centre[0] == pytest.approx(solution[:2], abs=1e-6)
    assert sorted(found.size[0]) == pytest.approx(sorted(solution[2:]), abs=1e-6)
    assert found.covariance[0] == pytest.approx(covariance[:2, :2], abs=1e-9)
