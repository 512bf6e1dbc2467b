"""Whether two runtimes find the same in one image. Pure."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from services.detector.runtime.overlap import boxes_of, ious

MIN_OVERLAP: Final = 0.9
MAX_SCORE_GAP: Final = 0.05


def difference(ours: Sequence[Detection], theirs: Sequence[Detection], confidence: float) -> str | None:
    """Say how two runtimes' objects differ by more than rounding, or None.

    What one finds and the other does not counts only if its score is more than MAX_SCORE_GAP above the confidence.
    """
    alike = _alike(ours, theirs)
    lonely = [*_lonely(ours, alike, confidence), *_lonely(theirs, alike.T, confidence)]
    if not lonely:
        return None
    worst = max(lonely, key=lambda found: found.score)
    return f"{len(lonely)} of {len(ours)} and {len(theirs)} objects, such as a {worst.name} of score {worst.score:.2f}"


def _lonely(objects: Sequence[Detection], alike: NDArray[np.bool_], confidence: float) -> list[Detection]:
    certain = confidence + MAX_SCORE_GAP
    return [each for each, others in zip(objects, alike, strict=True) if each.score > certain and not others.any()]


def _alike(ours: Sequence[Detection], theirs: Sequence[Detection]) -> NDArray[np.bool_]:
    """Return ours x theirs: whether two are the same object."""
    same = np.equal.outer([each.label for each in ours], [each.label for each in theirs])
    gaps = np.abs(np.subtract.outer([each.score for each in ours], [each.score for each in theirs]))
    return np.asarray(same & (gaps <= MAX_SCORE_GAP) & (ious(boxes_of(ours), boxes_of(theirs)) >= MIN_OVERLAP))
