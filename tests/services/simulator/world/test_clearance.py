import numpy as np
import pytest

from services.simulator.world import generate
from services.simulator.world.clearance import Clearance


@pytest.fixture(scope="module")
def clearance() -> Clearance:
    return Clearance.of(generate(1))


def test_cells_and_points_are_each_others_inverse(clearance: Clearance) -> None:
    cells = np.array([[0, 0], [17, 33], [100, 5]])
    assert np.array_equal(clearance.cells(clearance.points(cells)), cells)


def test_points_outside_the_hall_have_no_room(clearance: Clearance) -> None:
    assert clearance.at([[99.0, 0.0], [0.0, -99.0]]) == pytest.approx([0, 0])


def test_the_floor_under_an_object_has_no_room() -> None:
    scene = generate(1)
    corners = scene.cuboids.corners()
    standing = (scene.cuboids.instances > 0) & (corners[..., 2].min(axis=1) < 0.5)
    assert Clearance.of(scene).at(scene.cuboids.centres[standing, :2]).max() < 0.1
