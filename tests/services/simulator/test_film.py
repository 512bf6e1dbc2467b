import numpy as np

from services.simulator.film import Film
from services.simulator.world import Camera

SMALL = Camera.with_field_of_view(64, 48, 1.2)


def test_the_same_seed_is_the_same_film_and_another_is_not() -> None:
    first, again, other = Film(1, SMALL, 3), Film(1, SMALL, 3), Film(2, SMALL, 3)
    for number in (2, 0):
        assert np.array_equal(first.picture(number), again.picture(number))
        assert not np.array_equal(first.picture(number), other.picture(number))


def test_pictures_move_and_start_over() -> None:
    film = Film(1, SMALL, 3)
    assert film.picture(0).shape == (48, 64, 3)
    assert not np.array_equal(film.picture(0), film.picture(1))
    assert film.picture(4) is film.picture(1)
