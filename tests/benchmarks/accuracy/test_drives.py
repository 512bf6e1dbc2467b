from pathlib import Path

import numpy as np

from benchmarks.accuracy.drives import drawn, drive_seeds, held_out_drives
from services.training.dataset import training_seed
from services.training.evaluation.scenes import held_out_seeds

SEEDS = drive_seeds(1, 1)


def test_no_run_trains_on_them_and_no_other_figure_is_of_them() -> None:
    assert len(set(drive_seeds(1, 100))) == 100
    assert set(drive_seeds(1, 100)).isdisjoint(held_out_seeds(1, 10_000))
    assert training_seed(1, 500_000) < SEEDS[0] < training_seed(2, 0)


def test_a_drive_shows_the_same_objects_in_frame_after_frame() -> None:
    drive = drawn(SEEDS[0], 2)
    first, second = drive.frames
    assert first.image().shape == second.image().shape == (480, 640, 3)
    assert not np.array_equal(first.image(), second.image())
    names = [{each.identity: each.name for each in frame.seen} for frame in drive.frames]
    shared = names[0].keys() & names[1].keys()
    assert len(shared) >= len(names[0]) / 2 > 0
    assert all(names[0][identity] == names[1][identity] for identity in shared)
    for frame in drive.frames:
        assert len({each.identity for each in frame.seen}) == len(frame.seen)
        assert {each.mask.size for each in frame.seen} == {(480, 640)}
        assert {each.asked_for for each in frame.seen} == {True, False}


def test_drives_are_rendered_once(tmp_path: Path) -> None:
    reports: list[tuple[str, int, int]] = []
    first = list(held_out_drives(tmp_path, SEEDS, 1, 1, lambda *report: reports.append(report)))
    assert list(held_out_drives(tmp_path, SEEDS, 1, 1, lambda *report: reports.append(report))) == first
    assert [done for _, done, _ in reports] == [0, 1, 1]
    assert [len(drive.frames) for drive in first] == [1]
