"""Masks as COCO's own tools write them."""

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco

from schemas.detections import Mask


def coco_mask(pixels: NDArray[np.bool_]) -> Mask:
    """Encode a mask of height x width."""
    encoded = coco.encode(np.asfortranarray(pixels.astype(np.uint8)))
    return Mask(tuple(encoded["size"]), encoded["counts"].decode("ascii"))
