"""Computes COCO's average precision of masks, with pycocotools.

An object is asked for when at least half of it is visible and that is at least 0.1 % of the picture. Every other object
is an ignore region, COCO's `iscrowd`: a detection of its class that is not the match of one asked for, and lies on the
region with as large a share of itself as the IoU in question, is neither right nor wrong, and the object is not missed.
With an area range, COCO's other way to ignore, the detection would need that IoU with the object itself: one that takes
two slivers of the same box for two boxes would be wrong. A detection of another class there is wrong, as everywhere.

Masks count in the order of their objects' scores, times their own qualities where they have them, as in Mask Scoring
R-CNN (Huang et al., 2019). At most the 100 best of a class in a picture count. A size band asks for the objects of that
many visible pixels alone; the others, and detections of other sizes that match nothing, are neither right nor wrong in
it.
"""

import contextlib
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as masks
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from schemas.detections import Detection, Mask
from services.simulator.world import CLASSES
from services.training.evaluation.truths import Truth

MIN_AREA: Final = 0.001
MAX_DETECTIONS: Final = 100
EVERY_SIZE: Final = (0.0, 1e10)
SIZES: Final = {"small": (0.0, 32.0**2), "medium": (32.0**2, 96.0**2), "large": (96.0**2, 1e10)}
_CATEGORIES: Final[dict[str, int]] = {name: number for number, name in enumerate(CLASSES, start=1)}


@dataclass(frozen=True, slots=True)
class Precision:
    """Average precision at an IoU of 0.5 and over 0.5 to 0.95; None without ground truth.

    truths: how many objects were asked for.
    """

    map50: float | None
    map50_95: float | None
    truths: int


@dataclass(frozen=True, slots=True)
class MaskFigures:
    """Precision overall (the mean of the classes present), by class, and by size band (likewise).

    by_score: of all, if the masks' own qualities were not looked at.
    """

    overall: Precision
    by_score: Precision
    per_class: dict[str, Precision]
    per_size: dict[str, Precision]


@dataclass(slots=True)
class MaskScore:
    """Collects pictures."""

    _images: list[dict[str, int]] = field(default_factory=list)
    _truths: list[dict[str, Any]] = field(default_factory=list)
    _found: list[dict[str, Any]] = field(default_factory=list)
    _qualities: list[float] = field(default_factory=list)

    def add(self, size: tuple[int, int], truths: Sequence[Truth], detections: Sequence[Detection]) -> None:
        """Add the truth and the detections of one image of `size` (height, width).

        Raises:
            ValueError: a detection has no mask.
            KeyError: a detection is of a class that the world does not have.
        """
        self._images.append({"id": len(self._images) + 1, "height": size[0], "width": size[1]})
        for truth in truths:
            ignored = not truth.asked_for(MIN_AREA)
            self._truths.append(self._annotation(truth.name, truth.mask, iscrowd=int(ignored)))
        for found in detections:
            if found.mask is None:
                raise ValueError(f"a {found.name} without a mask")
            self._found.append(self._annotation(found.name, found.mask, iscrowd=0, score=found.score))
            self._qualities.append(1 if found.mask.quality is None else found.mask.quality)

    def figures(self) -> MaskFigures:
        """The result of the images so far."""
        judged = [
            {**found, "score": found["score"] * quality}
            for found, quality in zip(self._found, self._qualities, strict=True)
        ]
        precision = self._precision(judged)
        counts = np.array([[self._count(name, band) for band in SIZES.values()] for name in CLASSES])
        return MaskFigures(
            overall=_summary(precision[..., 0], counts),
            by_score=_summary(self._precision(self._found)[..., 0], counts),
            per_class={name: _summary(precision[:, :, k, 0], counts[k]) for k, name in enumerate(CLASSES)},
            per_size={name: _summary(precision[..., k + 1], counts[:, k]) for k, name in enumerate(SIZES)},
        )

    def _annotation(self, name: str, mask: Mask, **more: float) -> dict[str, Any]:
        segmentation = {"size": list(mask.size), "counts": mask.counts}
        category = _CATEGORIES[name]
        area = int(masks.area(segmentation))
        return {
            "image_id": len(self._images),
            "category_id": category,
            "segmentation": segmentation,
            "area": area,
            **more,
        }

    def _count(self, name: str, band: tuple[float, float]) -> int:
        """The number of true objects of a class in a size band, both ends included."""
        category = _CATEGORIES[name]
        asked_for = (each for each in self._truths if not each["iscrowd"] and each["category_id"] == category)
        return sum(band[0] <= each["area"] <= band[1] for each in asked_for)

    def _precision(self, found: list[dict[str, Any]]) -> NDArray[np.float64]:
        """Precision by IoU, recall, class and band (the first is every size); -1 without ground truth."""
        with contextlib.redirect_stdout(io.StringIO()):  # pycocotools talks
            evaluation = COCOeval(self._coco(self._truths), self._coco(found), "segm")
            evaluation.params.maxDets = [MAX_DETECTIONS]
            evaluation.params.areaRng = [list(band) for band in (EVERY_SIZE, *SIZES.values())]
            evaluation.params.areaRngLbl = ["every", *SIZES]
            evaluation.evaluate()
            evaluation.accumulate()
        return np.asarray(evaluation.eval["precision"][..., 0], np.float64)

    def _coco(self, annotations: list[dict[str, Any]]) -> COCO:
        made = COCO()
        made.dataset = {
            "images": self._images,
            "categories": [{"id": number, "name": name} for name, number in _CATEGORIES.items()],
            "annotations": [{"id": number, **each} for number, each in enumerate(annotations, start=1)],
        }
        made.createIndex()
        return made


def _summary(precision: NDArray[np.float64], counts: NDArray[np.int_]) -> Precision:
    """The mean over recalls and classes, at the first IoU and over all of them."""
    return Precision(_mean(precision[0]), _mean(precision), int(counts.sum()))


def _mean(precision: NDArray[np.float64]) -> float | None:
    known = precision[precision > -1]
    return float(known.mean()) if known.size else None
