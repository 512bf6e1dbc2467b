import numpy as np
import pytest

from benchmarks.worldmodel.recording import record
from benchmarks.worldmodel.replay import EXACT, PoseError, disturbed, replay
from services.training.dataset import holdout_seed


def test_errors_have_their_deviation_and_change_slowly() -> None:
    drawn = PoseError(0.05, 1.0, 30.0).drawn(np.random.default_rng(0), 20_000, 0.5)
    assert drawn.std(axis=0) == pytest.approx([0.05, 0.05, np.radians(1.0)], rel=0.15)
    assert np.diff(drawn[:, 0]).std() < 0.05 / 4
    later = drawn[:-240, 0] @ drawn[240:, 0] / len(drawn) / 0.05**2
    assert abs(later) < 0.2, "after four times as long nothing is left of it"


def test_a_pose_is_turned_where_it_is_and_then_moved() -> None:
    pose = np.eye(4)
    pose[:3, 3] = 3.0, 4.0, 1.0
    made = disturbed(pose, np.array([0.1, -0.2, np.pi / 2]))
    assert made[:3, 3] == pytest.approx([3.1, 3.8, 1.0])
    assert made[:3, 0] == pytest.approx([0, 1, 0])
    assert disturbed(pose, np.zeros(3)) == pytest.approx(pose)


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
