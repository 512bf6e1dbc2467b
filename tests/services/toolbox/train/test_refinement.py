from pathlib import Path

import numpy as np
import pytest
from pycocotools import mask as coco

from services.detector.settings import SHIPPED_MODEL
from services.toolbox.train.inference import open_weights
from services.toolbox.train.refinement import CONFIDENCE, REFINEMENT, open_look
from tests.services.simulator.views import near_view


def test_what_is_looked_at_closely_is_what_a_detector_finds(tmp_path: Path) -> None:
    rgb = np.ascontiguousarray(near_view()[..., ::-1])
    looks = open_look(SHIPPED_MODEL, "cpu", tmp_path)(rgb)
    found = open_weights(SHIPPED_MODEL, confidence=CONFIDENCE, device="cpu", folder=tmp_path)(rgb)
    assert len(looks.labels) == len(looks.pixels) == len(looks.features) == len(looks.masks) == len(found)
    assert looks.labels.tolist() == [each.label for each in found]
    assert looks.scores.tolist() == pytest.approx([each.score for each in found])
    assert looks.masks.any(axis=(1, 2)).all()


def test_where_nothing_is_found_there_is_nothing_to_look_at(tmp_path: Path) -> None:
    look = open_look(SHIPPED_MODEL, "cpu", tmp_path)
    nothing = np.full((480, 640, 3), 128, np.uint8)
    for image, some in ((nothing, False), (np.ascontiguousarray(near_view()[..., ::-1]), True), (nothing, False)):
        assert bool(len(look(image).labels)) is some


@pytest.mark.parametrize(("step", "rows"), [(1, 480), (1, 420), (2, 240), (2, 204)])
def test_a_pictures_masks_lie_in_close_ups_where_the_objects_do(tmp_path: Path, step: int, rows: int) -> None:
    rgb = np.ascontiguousarray(near_view()[::step, ::step, ::-1][:rows])
    looks = open_look(SHIPPED_MODEL, "cpu", tmp_path)(rgb)
    found = open_weights(SHIPPED_MODEL, confidence=CONFIDENCE, device="cpu", folder=tmp_path)(rgb)
    overlaps = []
    for each, (left, top, right, bottom), coarse in zip(found, looks.windows.tolist(), looks.masks, strict=True):
        assert each.mask is not None
        mask = coco.decode({"size": list(each.mask.size), "counts": each.mask.counts}) * np.uint8(255)
        shown = REFINEMENT.stretched(looks.letterboxed(mask)[top:bottom, left:right]) > 127
        overlaps.append(np.count_nonzero(shown & coarse) / np.count_nonzero(shown | coarse))
    assert np.median(overlaps) > 0.7
