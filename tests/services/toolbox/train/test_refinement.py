from pathlib import Path

import numpy as np

from services.detector.settings import SHIPPED_MODEL
from services.toolbox.train.inference import open_weights
from services.toolbox.train.refinement import CONFIDENCE, open_look
from tests.services.simulator.views import near_view


def test_what_is_looked_at_closely_is_what_a_detector_finds(tmp_path: Path) -> None:
    rgb = np.ascontiguousarray(near_view()[..., ::-1])
    looks = open_look(SHIPPED_MODEL, tmp_path)(rgb)
    found = open_weights(SHIPPED_MODEL, confidence=CONFIDENCE, device="cpu", folder=tmp_path)(rgb)
    assert len(looks.labels) == len(looks.pixels) == len(looks.features) == len(looks.masks) == len(found)
    assert looks.labels.tolist() == [each.label for each in found]
    for each, (left, top, right, bottom) in zip(found, looks.windows.tolist(), strict=True):
        assert left <= each.box.x1 < each.box.x2 <= right
        assert top <= each.box.y1 < each.box.y2 <= bottom
    assert looks.masks.any(axis=(1, 2)).all()


def test_windows_are_those_of_the_picture_whatever_size_the_model_looks_at(tmp_path: Path) -> None:
    rgb = np.ascontiguousarray(near_view()[..., ::-1])
    small = rgb[::2, ::2]
    looks = open_look(SHIPPED_MODEL, tmp_path)(np.ascontiguousarray(small))
    assert len(looks.windows)
    assert np.all(looks.windows >= 0)
    assert np.all(looks.windows[:, 2] <= small.shape[1])
    assert np.all(looks.windows[:, 3] <= small.shape[0])
    assert np.all(looks.windows[:, :2] < looks.windows[:, 2:])
