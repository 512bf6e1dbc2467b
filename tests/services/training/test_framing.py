import numpy as np
import pytest

from services.simulator.world import Rendering, generate
from services.simulator.world.clearance import Clearance
from services.training.viewpoints import draw_view, shows_enough


def rendering(object_pixels: int, depth: float) -> Rendering:
    instances = np.zeros((100, 100), np.int32)
    instances.ravel()[:object_pixels] = 1
    return Rendering(np.full((100, 100), depth, np.float32), instances, np.zeros((100, 100, 3), np.uint8))


@pytest.mark.parametrize(
    ("object_pixels", "depth", "enough"), [(31, 0.9, True), (30, 0.9, False), (31, 0.8, False), (0, 9.0, False)]
)
def test_a_view_shows_enough_with_objects_and_some_depth(object_pixels: int, depth: float, *, enough: bool) -> None:
    assert shows_enough(rendering(object_pixels, depth)) == enough


def test_a_view_is_the_same_for_the_same_seed() -> None:
    scene = generate(12)
    clearance = Clearance.of(scene)
    one, other = (draw_view(scene, clearance, np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one.rendering.color, other.rendering.color)
    assert shows_enough(one.rendering)
