"""What is truly in a picture."""

from typing import Final

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco

from schemas.detections import Mask
from services.simulator.training.framing import View
from services.simulator.world import Scene
from services.simulator.world import visibility

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


def truths_of(scene: Scene, view: View) -> list[Truth]:
    """Every object of which at least a pixel is visible."""
    instances = view.rendering.instances
    pixels = np.bincount(instances.ravel(), minlength=len(scene.instance_classes))
    return [
        Truth(
            name=scene.class_name(int(instance)),
            mask=encoded(instances == instance),
            pixels=int(pixels[instance]),
            visibility=float(pixels[instance] / _silhouette(scene, view, int(instance), int(pixels[instance]))),
        )
        for instance in np.flatnonzero(pixels[1:]) + 1
    ]


def encoded(visible: NDArray[np.bool_]) -> Mask:
    """A mask (height, width) as COCO run-length encoding."""
    rle = coco.encode(np.asfortranarray(visible, np.uint8))
    return Mask((rle["size"][0], rle["size"][1]), rle["counts"].decode("ascii"))


def _silhouette(scene: Scene, view: View, instance: int, least: int) -> int:
    own = scene.cuboids.instances == instance
    import dataclasses

    cub = dataclasses.replace(scene.cuboids, **{f.name: getattr(scene.cuboids, f.name)[own] for f in dataclasses.fields(scene.cuboids)})
    _, rings = visibility._facing_rings(cub, view.pose)
    polygons = visibility._project(rings, view.camera)
    low = np.clip(np.floor(np.min([p.min(axis=0) for p in polygons], axis=0)), -2000, 2000).astype(int)
    high = np.clip(np.ceil(np.max([p.max(axis=0) for p in polygons], axis=0)) + 1, -2000, 2600).astype(int)
    size = np.maximum(high - low, 1)
    canvas = np.zeros((size[1], size[0]), np.uint8)
    for p in polygons:
        cv2.fillConvexPoly(canvas, (np.clip(p - low, -10000, 10000) * 256).astype(np.int32), 1, cv2.LINE_8, 8)
    return max(least, int(np.count_nonzero(canvas)))
