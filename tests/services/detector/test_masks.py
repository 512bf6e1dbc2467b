import numpy as np
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from pycocotools import mask as coco

from services.detector.masks import to_coco


@given(arrays(np.uint8, array_shapes(min_dims=3, max_dims=3, max_side=9), elements={"min_value": 0, "max_value": 1}))
def test_masks_survive_coco(stack: NDArray[np.uint8]) -> None:
    encoded = to_coco(stack)
    decoded = [coco.decode({"size": list(mask.size), "counts": mask.counts.encode()}) for mask in encoded]
    assert np.array_equal(np.stack(decoded), stack)


def test_no_masks() -> None:
    assert to_coco(np.zeros((0, 4, 6), np.uint8)) == []
