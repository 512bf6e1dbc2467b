"""Ground truth of an image."""

from typing import Final

import msgspec
import numpy as np
from pycocotools import mask as coco

from schemas.detections import Mask
from services.simulator.world import Scene, SeenObject, truth_of
from services.training.viewpoints import CameraView

MIN_VISIBILITY: Final = 0.5


class Truth(msgspec.Struct, frozen=True, kw_only=True):
    """One visible object.

    mask: its visible pixels, at the picture's resolution. pixels: how many these are. visibility: their share of what
    would be seen of the object if nothing stood before it and the picture had no border.
    """

    name: str
    mask: Mask
    pixels: int
    visibility: float

    @property
    def area(self) -> float:
        """The share of the picture in which it is visible."""
        return self.pixels / (self.mask.size[0] * self.mask.size[1])

    def asked_for(self, least_area: float) -> bool:
        """Whether at least half of it is visible, and that is at least `least_area` of the picture."""
        return self.area >= least_area and self.visibility >= MIN_VISIBILITY


def truths_of(scene: Scene, view: CameraView) -> list[Truth]:
    """Every object of which at least a pixel is visible."""
    return [_truth(seen) for seen in truth_of(scene, view.rendering, view.pose, view.camera)]


def _truth(seen: SeenObject) -> Truth:
    return Truth(name=seen.name, mask=mask_of(seen), pixels=seen.pixels, visibility=seen.visibility)


def mask_of(seen: SeenObject) -> Mask:
    """The visible pixels of an object."""
    rle = coco.encode(np.asfortranarray(seen.full_mask(), np.uint8))
    return Mask((rle["size"][0], rle["size"][1]), rle["counts"].decode("ascii"))
