import pytest

from benchmarks.simulator.report import report


def view(render: float, wall: float = 100.0) -> dict[str, float]:
    return {"render": render, "smear": 5.0, "expose": 3.0, "depth": 7.0, "lidar": 12.0, "wall": wall}


def test_frames_per_second_are_those_of_all_frames_together() -> None:
    found = report([view(15.0), view(35.0), view(25.0, wall=300.0)])
    assert found["frames_per_s_one_core"] == 25.0
    assert found["frames_per_s_wall"] == 6.0
    assert found["render_ms"] == 25.0
    assert found["frame_ms"] == 40.0
    assert found["lidar_ms"] == 12.0
    assert found["spread"]["render_ms"] == [15.0, 35.0]
    assert "wall_ms" not in found


@pytest.mark.parametrize(("render", "met"), [(85.0, True), (86.0, False)])
def test_ten_frames_a_second_are_enough(render: float, met: bool) -> None:  # noqa: FBT001 - a parameter of the test
    assert report([view(render)])["targets"]["frames_per_s_one_core"]["met"] is met
