"""Whether two runtimes find the same in one image. Pure."""

from collections.abc import Sequence
from typing import Final

from schemas.detections import Box, Detection

MIN_OVERLAP: Final = 0.9
MAX_SCORE_GAP: Final = 0.05


def difference(ours: Sequence[Detection], theirs: Sequence[Detection], confidence: float) -> str | None:
    """Say how two runtimes' objects differ by more than rounding, or None.

    What one finds and the other does not counts unless its score is as good as the confidence asked for.
    """
    lonely = [*_without_counterpart(ours, theirs, confidence), *_without_counterpart(theirs, ours, confidence)]
    if not lonely:
        return None
    worst = max(lonely, key=lambda found: found.score)
    return f"{len(lonely)} of {len(ours)} and {len(theirs)} objects, such as a {worst.name} of score {worst.score:.2f}"


def _without_counterpart(some: Sequence[Detection], others: Sequence[Detection], confidence: float) -> list[Detection]:
    return [
        each
        for each in some
        if each.score > confidence + MAX_SCORE_GAP and not any(_is_counterpart(each, other) for other in others)
    ]


def _is_counterpart(one: Detection, other: Detection) -> bool:
    alike = one.label == other.label and abs(one.score - other.score) <= MAX_SCORE_GAP
    return alike and overlap(one.box, other.box) >= MIN_OVERLAP


def overlap(one: Box, other: Box) -> float:
    """Return the shared area of two boxes over the area of both together; 0 where neither has any."""
    wide = max(0.0, min(one.x2, other.x2) - max(one.x1, other.x1))
    high = max(0.0, min(one.y2, other.y2) - max(one.y1, other.y1))
    both = _area(one) + _area(other) - wide * high
    return wide * high / both if both > 0 else 0.0


def _area(box: Box) -> float:
    return (box.x2 - box.x1) * (box.y2 - box.y1)
