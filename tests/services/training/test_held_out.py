from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Detection
from services.training.evaluation.run import scored
from services.training.evaluation.scenes import draw_held_out
from tests.services.training.evaluation.pictures import echo


def test_a_model_that_is_always_right_has_full_marks_and_a_blind_one_none() -> None:
    views = [draw_held_out(seed) for seed in (9_600_000, 9_600_001)]
    answers = iter([echo(view.truths) for view in views])
    reports: list[int] = []

    def right(image: NDArray[np.uint8]) -> Sequence[Detection]:
        assert image.shape == (480, 640, 3)
        return next(answers)

    score = scored(views, right, reports.append)
    assert score.masks.figures().overall.map50_95 == pytest.approx(1)
    assert score.lists.figures(0.35).share == 1
    assert reports == [1, 2]
    blind = scored(views, lambda _image: [], reports.append)
    assert blind.masks.figures().overall.map50 == 0
    assert blind.lists.figures(0.35).exact == 0
