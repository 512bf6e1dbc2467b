"""Detection criteria of one model's classes. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.tuning import Tuning
from services.detector.model import TuningError

MAX_LISTED: Final = 20


@dataclass(frozen=True, slots=True)
class Criteria:
    """Detection criteria; see `schemas.tuning.Tuning`.

    labels: of those classes; None for all. agnostic: of overlapping boxes only the best one counts, whatever their
    classes.
    """

    confidence: float = 0.25
    iou: float = 0.7
    max_detections: int = 300
    classes: tuple[str, ...] = ()
    labels: NDArray[np.int64] | None = None
    agnostic: bool = False

    def tuned(self, tuning: Tuning, names: Mapping[int, str]) -> "Criteria":
        """Return these criteria with the changes of a tuning. names: of the model's classes, by label.

        Raises:
            TuningError: a class that the model does not know.
        """
        classes = self.classes if tuning.classes is None else tuple(dict.fromkeys(tuning.classes))
        return replace(
            self,
            confidence=self.confidence if tuning.confidence is None else tuning.confidence,
            iou=self.iou if tuning.iou is None else tuning.iou,
            max_detections=self.max_detections if tuning.max_detections is None else tuning.max_detections,
            classes=classes,
            labels=_labels(classes, names) if classes else None,
        )

    @property
    def tuning(self) -> Tuning:
        """These criteria as a message."""
        return Tuning(
            confidence=self.confidence, iou=self.iou, max_detections=self.max_detections, classes=list(self.classes)
        )


def _labels(classes: tuple[str, ...], names: Mapping[int, str]) -> NDArray[np.int64]:
    known = set(names.values())
    for name in classes:
        if name not in known:
            listed = [*list(names.values())[:MAX_LISTED], *(["..."] if len(names) > MAX_LISTED else [])]
            raise TuningError(f"no class is called {name[:80]!r}; the model knows {', '.join(listed)}")
    return np.array([label for label, name in names.items() if name in classes])
