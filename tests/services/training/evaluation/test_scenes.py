from pathlib import Path

import numpy as np
import pytest

from services.training.dataset import training_seed, views_of
from services.training.evaluation.scenes import draw_held_out, held_out_seeds, held_out_views
from services.training.files import TrainingError

SEEDS = held_out_seeds(9, 2)


class Recorder:
    def __init__(self) -> None:
        self.reports: list[tuple[str, int, int]] = []

    def __call__(self, stage: str, done: int, total: int) -> None:
        self.reports.append((stage, done, total))


def test_no_run_trains_on_them() -> None:
    for seed in (0, 1, 7):
        held_out = held_out_seeds(seed, 300)
        assert len(set(held_out)) == 300
        assert held_out[0] > training_seed(seed, 500_000)
        assert held_out[-1] < training_seed(seed + 1, 0)


def test_a_picture_is_taken_as_those_to_train_on_are() -> None:
    (image, labels), *_ = views_of(SEEDS[0], 1)
    view = draw_held_out(SEEDS[0])
    assert np.array_equal(view.image(), image)
    assert len(view.truths) >= len(labels) > 0


@pytest.mark.parametrize("workers", [1, 2])
def test_scenes_are_rendered_once(tmp_path: Path, workers: int) -> None:
    recorder = Recorder()
    first = list(held_out_views(tmp_path, SEEDS, workers, recorder))
    assert [view.seed for view in first] == SEEDS
    assert [done for _, done, _ in recorder.reports] == [0, 1, 2]
    again = Recorder()
    assert list(held_out_views(tmp_path, SEEDS, workers, again)) == first
    assert again.reports == [("render scenes", 2, 2)]


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    list(held_out_views(tmp_path, SEEDS[:1], 1, Recorder()))
    (file,) = tmp_path.rglob("*.msgpack")
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(TrainingError, match=rf"{file.name}: damaged .*; remove it"):
        list(held_out_views(tmp_path, SEEDS[:1], 1, Recorder()))
