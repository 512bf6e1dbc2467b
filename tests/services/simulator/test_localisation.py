import numpy as np
import pytest

from services.simulator.localisation import Drift, Localisation, Lost, disturbed

DRIFT = Drift(0.05, 1.0, 30.0)
USUAL = (0.05, 0.05, np.radians(1.0))


def errors(localisation: Localisation, seconds: np.ndarray) -> np.ndarray:
    return np.array([localisation.error(float(second)) for second in seconds])


def test_errors_have_their_deviation_and_their_time_constant() -> None:
    drawn = [errors(Localisation(DRIFT, seed=(seed,)), np.arange(0, 3_000, 1.0)) / USUAL for seed in range(12)]
    assert np.square(drawn).mean(axis=(0, 1)) == pytest.approx([1.0, 1.0, 1.0], rel=0.2)
    for later, left in ((15, np.exp(-0.5)), (30, np.exp(-1.0)), (120, np.exp(-4.0))):
        together = np.mean([each[:-later] * each[later:] for each in drawn], axis=(0, 1))
        assert together == pytest.approx([left] * 3, abs=0.15)
    apart = np.corrcoef(np.concatenate(drawn).T)
    assert np.abs(apart - np.identity(3)).max() < 0.15, "x, y and heading err on their own"


def test_errors_change_slowly_and_never_at_once() -> None:
    localisation = Localisation(DRIFT, seed=(3,))
    every = errors(localisation, np.arange(0, 60, 0.05))
    assert np.all(np.abs(np.diff(every, axis=0)).max(axis=0) < np.array(USUAL) / 5)


def test_the_same_seed_errs_the_same_at_any_time_in_any_order() -> None:
    one, other = Localisation(DRIFT, seed=(1, 2)), Localisation(DRIFT, seed=(1, 2))
    late = one.error(1_000_000.25)
    assert [one.error(7.0), late] == [other.error(7.0), other.error(1_000_000.25)]
    assert one.error(7.0) != Localisation(DRIFT, seed=(1, 3)).error(7.0)


def test_a_lost_robot_is_away_and_comes_back() -> None:
    found = Localisation(Drift(), [Lost("r1", 60.0, 80.0, 2.5)])
    assert found.error(59.9) == found.error(80.0) == (0.0, 0.0, 0.0)
    x, y, turn = found.error(60.0)
    assert np.hypot(x, y) == pytest.approx(2.5)
    assert 20 <= abs(np.degrees(turn)) <= 90
    assert found.error(79.9) == (x, y, turn)


def test_a_time_in_which_a_robot_is_lost_is_read_as_it_is_written() -> None:
    assert Lost.parse("r12=60-80.5", 4.0) == Lost("r12", 60.0, 80.5, 4.0)
    for text in ("r1", "r1=80-60", "r1=60-60", "1=60-80", "r1=-5-80", "r1=60-80 ", "r0=1-2"):
        with pytest.raises(ValueError, match=r"write r1=60-80"):
            Lost.parse(text)


def test_a_pose_is_turned_where_it_is_and_then_moved() -> None:
    pose = np.eye(4)
    pose[:3, 3] = 3.0, 4.0, 1.0
    made = disturbed(pose, (0.1, -0.2, np.pi / 2))
    assert made[:3, 3] == pytest.approx([3.1, 3.8, 1.0])
    assert made[:3, 0] == pytest.approx([0, 1, 0])
    assert disturbed(pose, (0.0, 0.0, 0.0)) == pytest.approx(pose)
