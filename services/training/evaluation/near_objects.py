"""Measures how a model names nearby objects on drives through unseen scenes."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from services.simulator.world import CLASSES, Camera, Drive, SeenObject, Sensor, expose, generate, render, truth_of
from services.training.evaluation.predictor import Predictor

NEAR_METRES: Final = 4.0
NEAR_AREA: Final = 0.01
MATCHING_IOU: Final = 0.5
FOUNDED_SHARE: Final = 0.1

Box = NDArray[np.float64]
"""Left, top, right, bottom."""


@dataclass(frozen=True, slots=True)
class NearFigures:
    """Near objects of each class on drives through unseen scenes: total, named right, and misnamed.

    `invented` counts the large predictions of each class in `pictures` where nothing of that class was.
    """

    pictures: int
    objects: dict[str, int]
    named: dict[str, int]
    misnamed: dict[str, int]
    invented: dict[str, int]

    @property
    def share(self) -> float:
        """The share of all near objects that were named right."""
        return sum(self.named.values()) / max(1, sum(self.objects.values()))


@dataclass(frozen=True, slots=True, eq=False)
class LabelledBox:
    """A prediction or a true object: its class and its box."""

    name: str
    box: Box


@dataclass(frozen=True, slots=True, eq=False)
class LabelledView:
    """An RGB picture, the near objects in it, and the class index of every pixel (-1 for the background)."""

    image: NDArray[np.uint8]
    near: list[LabelledBox]
    classes: NDArray[np.int32]


def near_figures(predict: Predictor, seeds: Sequence[int], frames: int, report: Callable[[int], None]) -> NearFigures:
    """Drive through the scenes of `seeds`, `frames` images each, and run the model on nearby objects."""
    objects, named, misnamed, invented = (Counter[str]() for _ in range(4))
    for done, seed in enumerate(seeds, start=1):
        for view in near_views(seed, frames):
            predictions = predicted(predict(view.image))
            invented.update(found.name for found in predictions if is_invented(found, view.classes))
            for truth in view.near:
                right, wrong = match(truth, predictions)
                objects[truth.name] += 1
                named[truth.name] += right
                misnamed[truth.name] += wrong and not right
        report(done)
    return NearFigures(len(seeds) * frames, dict(objects), dict(named), dict(misnamed), dict(invented))


def near_views(seed: int, frames: int) -> Iterator[LabelledView]:
    """Pictures (640x480) on a drive through the scene of `seed`."""
    scene, camera, rng = generate(seed), Camera(), np.random.default_rng([seed, 4])
    drive, sensor = Drive.plan(scene), Sensor()
    for index in range(frames):
        pose = drive.pose(index / frames)
        rendering = render(scene, pose, camera)
        image, near = expose(rendering.color, sensor, rng), near_objects(truth_of(scene, rendering, pose, camera))
        yield LabelledView(image, near, scene.instance_classes[rendering.instances])


def near_objects(objects: Iterable[SeenObject]) -> list[LabelledBox]:
    """The objects whose visible part is large in the image and within `NEAR_METRES`."""
    large = (each for each in objects if each.image_share >= NEAR_AREA)
    return [LabelledBox(each.name, _box(each)) for each in large if each.depth_m <= NEAR_METRES]


def _box(seen: SeenObject) -> Box:
    height, width = seen.mask.shape
    return np.array([seen.left, seen.top, seen.left + width, seen.top + height], np.float64)


def predicted(detections: Sequence[Detection]) -> list[LabelledBox]:
    """A model's detections, in the form to compare."""
    return [
        LabelledBox(each.name, np.array([each.box.x1, each.box.y1, each.box.x2, each.box.y2])) for each in detections
    ]


def match(truth: LabelledBox, predictions: list[LabelledBox]) -> tuple[bool, bool]:
    """Whether a prediction overlaps `truth` with the right name, and whether one does with a wrong name."""
    on_it = [p.name for p in predictions if box_iou(truth.box, p.box) >= MATCHING_IOU]
    return truth.name in on_it, any(name != truth.name for name in on_it)


def is_invented(prediction: LabelledBox, classes: NDArray[np.int32]) -> bool:
    """Whether a large prediction has almost nothing of its class inside its box."""
    left, top, right, bottom = np.rint(prediction.box).astype(int)
    window = classes[top:bottom, left:right]
    if window.size < NEAR_AREA * classes.size:
        return False
    names: tuple[str, ...] = CLASSES
    return bool(np.mean(window == names.index(prediction.name)) < FOUNDED_SHARE)


def box_iou(one: Box, other: Box) -> float:
    """Return the intersection over union of two boxes."""
    width, height = np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2])
    if width <= 0 or height <= 0:
        return 0.0
    areas = ((each[2] - each[0]) * (each[3] - each[1]) for each in (one, other))
    return float(width * height / (sum(areas) - width * height))
