"""A model's output to objects, as Ultralytics does it, but each mask only where its box is, and its own. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Box, Detection, Mask
from schemas.header import MAX_LABEL
from services.detector.masks import encode_window
from services.detector.runtime.criteria import Criteria
from services.detector.runtime.letterbox import Axis, Letterbox

Floats = NDArray[np.float32]

MAX_CANDIDATES: Final = 30_000
PLACES: Final = 4
"""Numbers of a box."""
ENDED: Final = 6
"""Numbers of a box, its score and its class, in the output of a model that suppresses doubles itself."""


MOSTLY: Final = 0.5
"""The share of a mask that surer objects of its class may cover at most: masks of things that there are do not overlap,
whatever their boxes do, and what shows no more of its own is one of them again, or a part of it."""


class OutputError(ValueError):
    """What a model put out is not what one of its task puts out."""


@dataclass(frozen=True, slots=True)
class Output:
    """What a model says of one image.

    predictions: (4 + classes + mask coefficients) x anchors, boxes as centre and size in pixels of the input; or, of a
    model that suppresses doubles itself, objects x (corners, score, class, mask coefficients).
    prototypes: mask coefficients x height x width; None of a model without masks.
    """

    predictions: Floats
    prototypes: Floats | None


@dataclass(frozen=True, slots=True)
class _Candidates:
    """Corners in pixels of the input (n x 4), scores (n), labels (n) and mask coefficients (n x m)."""

    corners: Floats
    scores: Floats
    labels: NDArray[np.int64]
    coefficients: Floats

    def __getitem__(self, which: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "_Candidates":
        return _Candidates(self.corners[which], self.scores[which], self.labels[which], self.coefficients[which])


def objects(
    output: Output, letterbox: Letterbox, criteria: Criteria, names: Mapping[int, str], *, masks: bool
) -> list[Detection]:
    """Return the objects of an image, best score first, with masks if asked for and known.

    Raises:
        OutputError: the output is not that of a model with these classes, or not a number.
    """
    found = _candidates(output, len(names), criteria)
    kept = found[_suppressed(found, criteria)] if _is_dense(output, len(names)) else found[: criteria.max_detections]
    if output.prototypes is not None:
        kept = kept[_apart(kept, output.prototypes, letterbox)]
    boxes = _in_image(kept.corners, letterbox)
    encoded: Sequence[Mask | None] = [None] * len(boxes)
    if masks and output.prototypes is not None:
        encoded = [_mask(*each, output.prototypes, letterbox) for each in zip(kept.coefficients, boxes, strict=True)]
    return [
        Detection(name=names[label][:MAX_LABEL], score=min(score, 1.0), box=Box(*box), mask=mask, label=label)
        for label, score, box, mask in zip(
            kept.labels.tolist(), kept.scores.tolist(), boxes.tolist(), encoded, strict=True
        )
    ]


def _is_dense(output: Output, classes: int) -> bool:
    extra = 0 if output.prototypes is None else len(output.prototypes)
    match output.predictions.shape:
        case (numbers, _) if numbers == PLACES + classes + extra:
            return True
        case (_, numbers) if numbers == ENDED + extra:
            return False
    raise OutputError(f"an output of {output.predictions.shape} from a model of {classes} classes")


def _candidates(output: Output, classes: int, criteria: Criteria) -> _Candidates:
    """Return what is sure enough and of a class that is reported, best first."""
    found = _dense(output, classes, criteria) if _is_dense(output, classes) else _ended(output, classes, criteria)
    if np.isnan(found.corners).any():
        raise OutputError("a box whose place is not a number")
    if criteria.labels is not None:
        found = found[np.isin(found.labels, criteria.labels)]
    return found[np.argsort(-found.scores, kind="stable")[:MAX_CANDIDATES]]


def _dense(output: Output, classes: int, criteria: Criteria) -> _Candidates:
    scores = output.predictions[PLACES : PLACES + classes]
    sure = np.flatnonzero(scores.max(axis=0) > criteria.confidence)
    chosen = np.ascontiguousarray(output.predictions[:, sure].T, np.float32)
    labels = chosen[:, PLACES : PLACES + classes].argmax(axis=1)
    best = np.take_along_axis(chosen, PLACES + labels[:, None], axis=1)[:, 0]
    centres, halves = chosen[:, :2], chosen[:, 2:PLACES] / 2
    corners = np.concatenate([centres - halves, centres + halves], axis=1)
    return _Candidates(corners, best, labels, chosen[:, PLACES + classes :])


def _ended(output: Output, classes: int, criteria: Criteria) -> _Candidates:
    rows = np.asarray(output.predictions[output.predictions[:, PLACES] > criteria.confidence], np.float32)
    labels = rows[:, PLACES + 1].astype(np.int64)
    if np.any((labels < 0) | (labels >= classes)):
        raise OutputError(f"a class beyond the {classes} that the model has")
    return _Candidates(rows[:, :PLACES], rows[:, PLACES], labels, rows[:, ENDED:])


def _suppressed(found: _Candidates, criteria: Criteria) -> NDArray[np.int64]:
    """Return which candidates, best first, overlap no better one of their class by more than the criteria allow."""
    kept: list[int] = []
    left = np.arange(len(found.scores))
    areas = np.prod(found.corners[:, 2:] - found.corners[:, :2], axis=1)
    while len(left) and len(kept) < criteria.max_detections:
        first, rest = left[0], left[1:]
        kept.append(int(first))
        here, others = found.corners[first], found.corners[rest]
        sides = np.minimum(here[2:], others[:, 2:]) - np.maximum(here[:2], others[:, :2])
        shared = np.prod(np.maximum(sides, 0), axis=1)
        overlap = shared > criteria.iou * (areas[first] + areas[rest] - shared)
        left = rest[~(overlap & (found.labels[rest] == found.labels[first]))]
    return np.array(kept, np.int64)


def _apart(found: _Candidates, prototypes: Floats, letterbox: Letterbox) -> NDArray[np.int64]:
    """Return which objects, best first, are not MOSTLY covered by better ones of their class."""
    height, width = prototypes.shape[1:]
    scale = np.array([width / letterbox.columns.input, height / letterbox.rows.input] * 2, np.float32)
    windows = np.clip(np.rint(found.corners * scale), 0, [width, height] * 2).astype(int).tolist()
    covered: dict[int, NDArray[np.bool_]] = {}
    apart: list[int] = []
    for n, (label, (left, top, right, bottom)) in enumerate(zip(found.labels.tolist(), windows, strict=True)):
        window = (slice(top, bottom), slice(left, right))
        mask = np.einsum("c,chw->hw", found.coefficients[n], prototypes[:, *window]) > 0  # no BLAS, so no threads
        before = covered.setdefault(label, np.zeros((height, width), np.bool_))[window]
        if np.count_nonzero(mask & before) <= MOSTLY * np.count_nonzero(mask):
            before |= mask
            apart.append(n)
    return np.array(apart, np.int64)


def _in_image(corners: Floats, letterbox: Letterbox) -> Floats:
    across = letterbox.columns.to_image(corners[:, 0::2])
    down = letterbox.rows.to_image(corners[:, 1::2])
    return np.stack([across[:, 0], down[:, 0], across[:, 1], down[:, 1]], axis=1)


def _mask(coefficients: Floats, box: Floats, prototypes: Floats, letterbox: Letterbox) -> Mask:
    """Return a mask in the image's own resolution: the prototypes' sum, interpolated where the box is, above zero."""
    left, top, right, bottom = np.ceil(box).astype(int).tolist()
    rows = _Taps.of(letterbox.rows, top, bottom, prototypes.shape[1])
    columns = _Taps.of(letterbox.columns, left, right, prototypes.shape[2])
    small = np.einsum("c,chw->wh", coefficients, prototypes[:, rows.where, columns.where])  # see above
    logits = rows.apply(columns.apply(small).T)
    return encode_window((logits > 0).T, top, left, letterbox.rows.image, letterbox.columns.image)


@dataclass(frozen=True, slots=True)
class _Taps:
    """Linear interpolation along one axis: pixel n is between two places, `share` of the way from the first."""

    where: slice
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    share: Floats

    @classmethod
    def of(cls, axis: Axis, begin: int, end: int, size: int) -> "_Taps":
        """Find the image's pixels from `begin` to `end` among `size` places; the image's padding has no say."""
        ratio = size / axis.input
        low = axis.before * ratio
        high = max(low, low + axis.content * ratio - 1)
        pixels = np.arange(begin, end) + 0.5
        places = np.clip(low + pixels * (axis.content * ratio / axis.image) - 0.5, low, min(high, size - 1))
        before = places.astype(np.int64)
        after = np.minimum(before + 1, size - 1)
        first, last = (int(before[0]), int(after[-1]) + 1) if len(pixels) else (0, 1)
        return cls(slice(first, last), before - first, after - first, (places - before).astype(np.float32)[:, None])

    def apply(self, places: Floats) -> Floats:
        """Interpolate rows of places: one row per pixel."""
        values = np.take(places, self.before, axis=0)
        step = np.take(places, self.after, axis=0)
        step -= values
        step *= self.share
        values += step
        return values
