import numpy as np
import pytest

from services.geometry.errors import MaskError
from services.geometry.runs import Runs
from tests.schemas.masks import coco_mask


def test_runs_of_several_masks_go_down_columns_side_by_side() -> None:
    first, second = np.zeros((3, 4), np.bool_), np.zeros((3, 4), np.bool_)
    first[1:, 0] = first[0, 1] = True  # one run over the end of a column
    second[2, 3] = second[0, 0] = True
    empty = np.zeros((3, 4), np.bool_)
    runs = Runs.of([coco_mask(each).counts for each in (first, empty, second)], 3, 4)
    assert runs.starts.tolist() == [1, 24, 35]
    assert runs.stops.tolist() == [4, 25, 36]
    assert runs.bounds.tolist() == [0, 1, 1, 3]


@pytest.mark.parametrize("counts", ["", "=", "ü"])
def test_one_that_is_damaged_damages_all(counts: str) -> None:
    sound = coco_mask(np.ones((3, 4), np.bool_)).counts
    with pytest.raises(MaskError):
        Runs.of([sound, counts], 3, 4)


def test_runs_that_together_are_more_than_can_be_counted_are_refused() -> None:
    with pytest.raises(MaskError, match="the mask has 12"):
        Runs.of(["0" + "oooooo?" * 3], 3, 4)
