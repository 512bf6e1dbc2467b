"""Made up pictures of 200 x 100 pixels: what is in them and what is found."""

import numpy as np
from pycocotools import mask as coco

from schemas.detections import Box, Detection, Mask
from services.training.evaluation.truths import Truth

SIZE = (100, 200)


def mask(left: int, top: int, right: int, bottom: int) -> Mask:
    """Return the mask of a rectangle."""
    pixels = np.zeros(SIZE, np.uint8, order="F")
    pixels[top:bottom, left:right] = 1
    return Mask(SIZE, coco.encode(pixels)["counts"].decode("ascii"))


def truth(name: str, left: int, top: int, right: int, bottom: int, *, visibility: float = 1.0) -> Truth:
    """Return an object seen in a rectangle."""
    pixels = (right - left) * (bottom - top)
    return Truth(name=name, mask=mask(left, top, right, bottom), pixels=pixels, visibility=visibility)


def found(name: str, left: int, top: int, right: int, bottom: int, *, score: float = 0.9) -> Detection:
    """Return a detection of a rectangle."""
    box = Box(left, top, right, bottom)
    return Detection(name=name, score=score, box=box, mask=mask(left, top, right, bottom))


def echo(truths: list[Truth]) -> list[Detection]:
    """Return what a model would find that is always right."""
    box = Box(0, 0, 1, 1)
    return [Detection(name=each.name, score=1.0, box=box, mask=each.mask) for each in truths]
