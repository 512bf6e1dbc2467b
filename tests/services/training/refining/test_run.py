from pathlib import Path

import numpy as np

from services.training.refining.refinement import Looks, Refinement, RefinerLook
from services.training.refining.run import TrainedRefiner, refine
from services.training.settings import TrainingSettings


def open_blind(_weights: Path, _device: str, _folder: Path) -> RefinerLook:
    """See nothing anywhere."""
    nothing = Looks(
        np.zeros((0, 8, 8, 6), np.uint8),
        np.zeros((0, 4, 4, 1), np.float16),
        np.zeros(0, np.int64),
        np.zeros(0, np.float32),
        np.zeros((0, 4), np.int64),
        np.zeros((0, 8, 8), np.bool_),
        letterboxed=lambda whole: whole,
    )
    return lambda _image: nothing


def unused(*_: object) -> dict[str, object]:
    raise AssertionError


def test_of_too_little_nothing_is_learned(tmp_path: Path) -> None:
    blind = Refinement(open_blind, unused, unused, unused, unused)  # type: ignore[arg-type]
    settings = TrainingSettings(images=2, refiner_images=2, workers=1, work_dir=tmp_path)
    reports: list[tuple[str, int, int]] = []
    found = refine(settings, Path("x.pt"), blind, lambda *report: reports.append((*report,)))
    assert found == TrainedRefiner({}, 0)
    assert reports == [("look", 0, 1), ("look", 1, 1)]


def test_no_pictures_no_refiner(tmp_path: Path) -> None:
    blind = Refinement(open_blind, unused, unused, unused, unused)  # type: ignore[arg-type]
    settings = TrainingSettings(refiner_images=0, workers=1, work_dir=tmp_path)
    assert refine(settings, Path("x.pt"), blind, lambda *_: None) == TrainedRefiner({}, 0)
