import numpy as np

from services.simulator.world.sensor import PLANE, window


def test_a_window_goes_on_beyond_the_border() -> None:
    plane = np.arange(PLANE * PLANE).reshape(PLANE, PLANE)
    rng = np.random.default_rng(4)
    for height, width in ((3, 5), (PLANE + 7, 2), (1, 2 * PLANE)):
        taken = window(plane, height, width, rng)
        assert taken.shape == (height, width)
        rows, columns = taken[:, 0] // PLANE, taken[0] % PLANE
        assert ((np.diff(rows) % PLANE) == 1).all()
        assert ((np.diff(columns) % PLANE) == 1).all()
        assert (taken % PLANE == columns).all()


def test_windows_are_those_of_the_seed() -> None:
    plane = np.random.default_rng(1).normal(size=(PLANE, PLANE, 3))
    one, same, other = (window(plane, 8, 9, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one.shape == (8, 9, 3)
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
