"""Measures how often the list of classes in view is right."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from schemas.detections import Detection
from services.training.evaluation.truths import Truth

REQUIRED_AREA: Final = 0.003
VISIBLE_AREA: Final = 0.0005


@dataclass(frozen=True, slots=True)
class ListFigures:
    """Errors of class lists at `confidence`: number of images in which each class was missed or invented."""

    confidence: float
    pictures: int
    exact: int
    missed: dict[str, int]
    invented: dict[str, int]

    @property
    def share(self) -> float:
        """The share of the pictures whose list is right."""
        return self.exact / max(1, self.pictures)


@dataclass(frozen=True, slots=True)
class _Picture:
    required: frozenset[str]
    allowed: frozenset[str]
    best: dict[str, float]


@dataclass(slots=True)
class ListScore:
    """Collects pictures.

    A list is right that has every class with an object of which at least half is visible, on at least 0.3 % of the
    picture, and no class without an object that is visible on more than 0.05 % of it.
    """

    _pictures: list[_Picture] = field(default_factory=list)

    def add(self, truths: Sequence[Truth], detections: Sequence[Detection]) -> None:
        """Add the truth and the detections of one image."""
        best: dict[str, float] = {}
        for found in detections:
            best[found.name] = max(found.score, best.get(found.name, 0))
        required = frozenset(truth.name for truth in truths if truth.asked_for(REQUIRED_AREA))
        allowed = frozenset(truth.name for truth in truths if truth.area > VISIBLE_AREA)
        self._pictures.append(_Picture(required, allowed, best))

    def figures(self, confidence: float) -> ListFigures:
        """The result of the images so far if detections count from `confidence` on."""
        exact, missed, invented = 0, Counter[str](), Counter[str]()
        for picture in self._pictures:
            listed = {name for name, score in picture.best.items() if score >= confidence}
            missed.update(picture.required - listed)
            invented.update(listed - picture.allowed)
            exact += picture.required <= listed <= picture.allowed
        return ListFigures(confidence, len(self._pictures), exact, dict(missed), dict(invented))
