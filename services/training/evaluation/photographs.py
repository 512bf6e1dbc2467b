"""How a model does on photographs: recall and precision of each class, and false alarms, at the default confidence.

A prediction is right if its box and a label's of its class overlap with an IoU of at least 0.5, one to one, the best
scores first. Of a class that a picture's source does not label completely, predictions are neither right nor wrong.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from services.simulator.world import CLASSES
from services.training.evaluation.near_objects import MATCHING_IOU, Box, box_iou
from services.training.evaluation.predictor import Predictor
from services.training.files import TrainingError
from services.training.photographs import Photograph


@dataclass(slots=True)
class ClassScore:
    """Counts of one class: labelled objects, those found, each by a prediction of its own, and wrong predictions."""

    labelled: int = 0
    found: int = 0
    wrong: int = 0

    @property
    def recall(self) -> float | None:
        return round(self.found / self.labelled, 3) if self.labelled else None

    @property
    def precision(self) -> float | None:
        return round(self.found / (self.found + self.wrong), 3) if self.found + self.wrong else None


@dataclass(slots=True)
class PhotographScore:
    """Scores by class, over sources that label it, and the false alarms on pictures without any of the classes.

    names: the classes, in the order of their indices.
    """

    names: Sequence[str] = CLASSES
    pictures: int = 0
    classes: dict[str, ClassScore] = field(init=False)
    empty_pictures: int = 0
    false_alarms: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self.classes = {name: ClassScore() for name in self.names}

    def add(self, photograph: Photograph, found: Sequence[Detection], width: int, height: int) -> None:
        """Count one picture's predictions."""
        self.pictures += 1
        if not photograph.objects and len(photograph.absent) == len(self.names):
            self.empty_pictures += 1
            self.false_alarms.update(each.name for each in found if each.name in self.names)
        for index, name in enumerate(self.names):
            if index not in photograph.absent | photograph.unknown:
                self._count(photograph, index, [each for each in found if each.name == name], width, height)

    def _count(self, photograph: Photograph, index: int, found: Sequence[Detection], width: int, height: int) -> None:
        scale = np.array((width, height, width, height))
        labels = [np.array(each.box) * scale for each in photograph.objects if each.class_index == index]
        boxes = [np.array((each.box.x1, each.box.y1, each.box.x2, each.box.y2)) for each in found]
        matched = matches(labels, boxes)
        score = self.classes[self.names[index]]
        score.labelled += len(labels)
        score.found += matched
        score.wrong += len(found) - matched

    @property
    def false_alarms_per_picture(self) -> float | None:
        return round(self.false_alarms.total() / self.empty_pictures, 3) if self.empty_pictures else None

    @property
    def f1(self) -> float:
        """Over all classes, 0 where nothing is labelled; false alarms on empty pictures are wrong predictions, too."""
        found = sum(each.found for each in self.classes.values())
        wrong = sum(each.wrong for each in self.classes.values()) + self.false_alarms.total()
        labelled = sum(each.labelled for each in self.classes.values())
        return 2 * found / (labelled + found + wrong) if labelled else 0.0

    def summary(self) -> dict[str, Any]:
        """Return the figures by name."""
        return {
            "pictures": self.pictures,
            "recall": {name: score.recall for name, score in self.classes.items() if score.labelled},
            "precision": {name: score.precision for name, score in self.classes.items() if score.labelled},
            "labelled": {name: score.labelled for name, score in self.classes.items() if score.labelled},
            "false_alarms_per_empty_picture": self.false_alarms_per_picture,
            "empty_pictures": self.empty_pictures,
            "false_alarms": dict(self.false_alarms),
        }


def matches(labels: Sequence[Box], boxes: Sequence[Box]) -> int:
    """Return how many boxes, in their order, find a label of their own: the one of the best IoU that is left."""
    left = list(labels)
    count = 0
    for box in boxes:
        overlaps = [box_iou(box, label) for label in left]
        best = max(range(len(left)), key=overlaps.__getitem__, default=None)
        if best is not None and overlaps[best] >= MATCHING_IOU:
            left.pop(best)
            count += 1
    return count


def score_photographs(
    photographs: Iterable[Photograph],
    predict: Predictor,
    report: Callable[[int], None],
    look: Callable[[Photograph, NDArray[np.uint8], Sequence[Detection]], None] = lambda *_: None,
    classes: Sequence[str] = CLASSES,
) -> Mapping[str, PhotographScore]:
    """Run the model on each photograph; return the scores by source, and of all of them as "all".

    classes: of the photographs, in the order of their indices. report: called with the number of photographs that are
    done. look: called with each picture (RGB) and its predictions.

    Raises:
        TrainingError: a photograph is no picture.
    """
    scores = {"all": PhotographScore(classes)}
    for done, photograph in enumerate(photographs, start=1):
        picture = cv2.imread(str(photograph.file), cv2.IMREAD_COLOR)
        if picture is None:
            raise TrainingError(f"{photograph.file}: not a picture that can be read")
        image = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
        found = predict(image)
        look(photograph, image, found)
        for source in ("all", photograph.source):
            scores.setdefault(source, PhotographScore(classes)).add(photograph, found, image.shape[1], image.shape[0])
        report(done)
    return scores
