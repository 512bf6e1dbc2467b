import numpy as np
import pytest

from services.simulator.film import Store

POINTS = np.dtype([("x", "<f4"), ("ring", "<u2")])


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24, dtype=np.uint8).reshape(2, 4, 3),
        np.array([[0.5, np.nan]], np.float32),
        np.array([[(1.5, 3)], [(2.5, 4)]], POINTS),
        np.arange(12, dtype=np.uint16).reshape(3, 4)[:, ::2],
    ],
)
def test_what_is_kept_comes_back_as_it_was(array: np.ndarray) -> None:
    store = Store(1000)
    store.put("key", array)
    found = store.get("key")
    assert found is not None
    assert found.dtype == array.dtype
    assert np.array_equal(found, array, equal_nan=array.dtype.kind == "f")


def test_what_does_not_fit_is_not_kept_and_what_was_there_stays() -> None:
    noise = np.random.default_rng(1).integers(0, 256, 600, np.uint8)
    store = Store(1000)
    store.put(1, noise)
    assert 600 <= store.size <= 1000
    store.put(2, noise)
    assert store.get(1) is not None
    assert store.get(2) is None
    assert (store.size <= 1000, store.refused) == (True, 1)
    store.put(3, np.zeros(600, np.uint8))
    assert store.get(3) is not None
