"""Detection criteria of one model's classes, and their names. Pure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.tuning import Tuning
from services.detector.model import TuningError

MAX_LISTED: Final = 20


@dataclass(frozen=True, slots=True)
class Criteria:
    """Detection criteria; see `schemas.tuning.Tuning`.

    agnostic: of overlapping boxes only the best one counts, whatever their classes. class_confidence: by name, of
    classes for which another score than `confidence` is needed.

    Made from these and a model's names by `tuned`: labels, of the classes that are reported, None for all; scores, that
    each label needs, None where all need `confidence`; same, for each label the first label of the same name, None
    where each class has a name of its own.
    """

    confidence: float = 0.25
    iou: float = 0.7
    max_detections: int = 300
    classes: tuple[str, ...] = ()
    agnostic: bool = False
    class_confidence: Mapping[str, float] = field(default_factory=dict)
    labels: NDArray[np.int64] | None = None
    scores: NDArray[np.float32] | None = None
    same: NDArray[np.int64] | None = None

    def tuned(self, tuning: Tuning, names: Mapping[int, str]) -> "Criteria":
        """Return these criteria with the changes of a tuning. names: of the model's classes, by label.

        Raises:
            TuningError: a class that the model does not know.
        """
        classes = self.classes if tuning.classes is None else tuple(dict.fromkeys(tuning.classes))
        confidence = self.confidence if tuning.confidence is None else tuning.confidence
        _check(classes, names)
        return replace(
            self,
            confidence=confidence,
            iou=self.iou if tuning.iou is None else tuning.iou,
            max_detections=self.max_detections if tuning.max_detections is None else tuning.max_detections,
            classes=classes,
            labels=np.array([label for label, name in names.items() if name in classes]) if classes else None,
            scores=self._scores(confidence, names),
            same=merged(names),
        )

    @property
    def tuning(self) -> Tuning:
        """These criteria as a message."""
        return Tuning(
            confidence=self.confidence, iou=self.iou, max_detections=self.max_detections, classes=list(self.classes)
        )

    @property
    def least_score(self) -> float:
        """The score above which an object of some class counts."""
        return self.confidence if self.scores is None else float(self.scores.min())

    @property
    def greatest_score(self) -> float:
        """The score above which an object of any class counts."""
        return self.confidence if self.scores is None else float(self.scores.max())

    def _scores(self, confidence: float, names: Mapping[int, str]) -> NDArray[np.float32] | None:
        if not self.class_confidence:
            return None
        _check(self.class_confidence, names)
        each = [self.class_confidence.get(names[label], confidence) for label in sorted(names)]
        return np.array(each, np.float32)


def _check(classes: Iterable[str], names: Mapping[int, str]) -> None:
    known = set(names.values())
    for name in classes:
        if name not in known:
            raise TuningError(f"no class is called {name[:80]!r}; the model knows {listed(names.values())}")


def renamed(names: Mapping[int, str], changes: Mapping[str, str]) -> dict[int, str]:
    """Return the names of a model's classes, by label, after changes from old names to new ones.

    Classes that get one name are one class from then on.
    """
    return {label: changes.get(name, name) for label, name in names.items()}


def merged(names: Mapping[int, str]) -> NDArray[np.int64] | None:
    """Return for each label the first label of the same name; None where each class has a name of its own."""
    first: dict[str, int] = {}
    labels = [first.setdefault(names[label], label) for label in sorted(names)]
    return None if len(first) == len(labels) else np.array(labels)


def listed(names: Iterable[str]) -> str:
    """Return names for a message: the first MAX_LISTED of them."""
    known = list(dict.fromkeys(names))
    return ", ".join([*known[:MAX_LISTED], *(["..."] if len(known) > MAX_LISTED else [])])
