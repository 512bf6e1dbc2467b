import numpy as np
import pytest

from benchmarks.worldmodel.recording import record
from benchmarks.worldmodel.replay import EXACT, replay
from services.simulator.localisation import Drift, Localisation, Lost, disturbed
from services.training.dataset import holdout_seed


def test_each_robot_drives_its_round_again_and_again_in_turns() -> None:
    nothing = [record(holdout_seed(1, 300_000), number, 0.1, lambda _: []) for number in range(2)]
    played = list(replay(nothing, 100.0, EXACT, 0))
    assert [each.view.header.robot for each in played[:4]] == ["r1", "r2", "r1", "r2"]
    assert [each.second for each in played[:3]] == [0.0, 5.0, 10.0]
    assert len(played) == 20
    count = len(nothing[0].images)
    assert played[0].image == played[2 * count].image
    for each in played:
        assert each.view.grid is not None
        assert each.view.position == pytest.approx(np.array(each.image.pose)[:3, 3])


def test_poses_are_off_as_the_simulators_localisation_is() -> None:
    nothing = [record(holdout_seed(1, 300_000), number, 0.1, lambda _: []) for number in range(2)]
    drift, lost = Drift(0.05, 1.0), [Lost("r2", 20.0, 40.0)]
    for number, played in enumerate(replay(nothing, 50.0, drift, 7, lost=lost)):
        error = Localisation(drift, lost if number % 2 else (), (7, number % 2)).error(played.second)
        assert np.hypot(*error[:2]) > 2.0 or played.second < 20 or played.second >= 40 or number % 2 == 0
        assert played.view.position == pytest.approx(disturbed(np.array(played.image.pose), error)[:3, 3])


def test_other_images_follow_and_a_replay_can_begin_late() -> None:
    rounds = [record(holdout_seed(1, 300_000), number, 0.1, lambda _: []) for number in range(2)]
    then = [rounds[0].images[3], rounds[1].images[2]]
    whole = list(replay(rounds, 20.0, EXACT, 0, then=then))
    assert [each.second for each in whole] == [0.0, 5.0, 10.0, 15.0, 20.0, 25.0]
    assert [each.image for each in whole[-2:]] == then
    late = list(replay(rounds, 20.0, EXACT, 0, then=then, since_s=10.0))
    assert [each.second for each in late] == [10.0, 15.0, 20.0, 25.0]
    assert [each.view.position for each in late] == [each.view.position for each in whole[2:]]
