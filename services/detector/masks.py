"""Binary masks to COCO run-length encoding."""

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco

from schemas.detections import Mask


def to_coco(stack: NDArray[np.uint8]) -> list[Mask]:
    """Encode n x height x width masks of zeros and ones."""
    if not len(stack):
        return []
    encoded = coco.encode(np.asfortranarray(stack.transpose(1, 2, 0)))
    return [Mask((rle["size"][0], rle["size"][1]), rle["counts"].decode("ascii")) for rle in encoded]
