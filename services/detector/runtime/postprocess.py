"""Turns a model's output into objects as Ultralytics does, but with masks computed only in their boxes. Pure."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Box, Detection, Mask
from schemas.header import MAX_LABEL
from services.detector.runtime.candidates import Candidates, suppressed
from services.detector.runtime.criteria import Criteria
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.masks import Taps, encode_all
from services.detector.runtime.model_file import DETECTION, Head, Task
from services.detector.runtime.object_shapes import (
    filled,
    keypoints_of,
    rotated_boxes,
    rotated_suppressed,
    upright,
)
from services.detector.runtime.refinement.refiner import BOX, CloseUps, Refined, own_parts
from services.geometry.masks import Window

Floats = NDArray[np.float32]

MAX_CANDIDATES: Final = 30_000
LEAST_LOOKED_AT: Final = 300
"""Candidates of an NMS-free head among which those of the classes that are reported are looked for, however few of them
are."""
PLACES: Final = 4
"""Numbers of a box."""
ENDED: Final = 6
"""Numbers of a box, its score and its class, in the output of a model that suppresses doubles itself."""


MOSTLY: Final = 0.5
"""The share of a mask that surer objects of its class may cover at most: masks of things that there are do not overlap,
whatever their boxes do, and what shows no more of its own is one of them again, or a part of it."""


FEW: Final = 16
"""Places of the prototypes, each of a pixel or more, below which none of a mask's may be a pixel of the image."""

NOTHING: Final = np.float32(-10)
"""Log odds of what is surely none of an object's."""


class OutputError(ValueError):
    """The output does not fit the model's task."""


@dataclass(frozen=True, slots=True)
class Output:
    """A model's output for one image.

    predictions: (4 + classes + extras) x anchors, boxes as centre and size in pixels of the input; or, of a model that
    suppresses doubles itself, objects x (corners, score, class, extras); or, of RT-DETR, objects x (centre and size as
    shares of the input, score, class); or, of a model that classifies, one score for each class. extras: mask
    coefficients, or what its `Task` says.
    prototypes: mask coefficients x height x width; None of a model without masks.
    """

    predictions: Floats
    prototypes: Floats | None


@dataclass(frozen=True, slots=True)
class _Layout:
    """The meaning of the numbers in the output of a model with so many classes."""

    classes: int
    head: Head
    task: Task

    def is_dense(self, output: Output) -> bool:
        """Return whether an output has one value for every place of the image."""
        return len(output.predictions) == PLACES + self.classes + self.extras(output)

    def extras(self, output: Output) -> int:
        """Return the number of mask coefficients, or of other extras, per object."""
        return self.task.extras if output.prototypes is None else len(output.prototypes)


Refine = Callable[[Candidates, Floats], tuple[CloseUps, Refined] | None]
"""Looks at objects closely, best first, with the prototypes of their masks; also returns what it saw. Nothing where it
cannot: masks then stay coarse."""


def objects(
    output: Output,
    letterbox: Letterbox,
    criteria: Criteria,
    names: Mapping[int, str],
    *,
    masks: bool,
    refine: Refine | None = None,
    head: Head = "nms",
    task: Task = DETECTION,
) -> list[Detection]:
    """Return the objects of an image, best score first, with masks if wanted and available, refined if possible.

    An object of whose mask there is no pixel is left out, whether masks are asked for or not. Classes of a whole image
    are objects as large as it.

    Raises:
        OutputError: the output is not that of a model with these classes, or not a number.
    """
    if task.kind == "classify":
        return _classified(output, letterbox, criteria, names)
    layout = _Layout(len(names), head, task)
    found = _candidates(output, letterbox, layout, criteria)
    doubles = (head == "nms" and layout.is_dense(output)) or criteria.same is not None
    kept = found[_without_doubles(found, criteria, task) if doubles else slice(criteria.max_detections)]
    if task.extras:
        shaped = _shaped(kept, letterbox, _classes(kept, criteria).tolist(), task, masks=masks)
        return [msgspec.structs.replace(each, name=names[each.label][:MAX_LABEL]) for each in shaped]
    if output.prototypes is not None:
        if len(kept.labels) and not np.isfinite(output.prototypes).all():
            raise OutputError("prototypes of masks that are not numbers")
        kept = kept[_apart(kept, output.prototypes, letterbox, _classes(kept, criteria))]
    boxes = _in_image(kept.corners, letterbox)
    encoded: list[Mask | None] = [None] * len(boxes)
    if masks and output.prototypes is not None and len(boxes):
        size = letterbox.rows.image, letterbox.columns.image
        looked = None if refine is None else refine(kept, output.prototypes)
        if looked is None:
            encoded[:] = encode_all(_windows(kept.coefficients, boxes, output.prototypes, letterbox), *size)
        else:
            seen, refined = looked
            windows = _fitted(boxes, _refined(seen, refined.odds, letterbox))
            encoded[:] = map(_judged, encode_all(windows, *size), refined.qualities.tolist())
    return [
        Detection(name=names[label][:MAX_LABEL], score=min(score, 1.0), box=Box(*box), mask=mask, label=label)
        for label, score, box, mask in zip(
            _classes(kept, criteria).tolist(), kept.scores.tolist(), boxes.tolist(), encoded, strict=True
        )
    ]


def _shaped(
    found: Candidates, letterbox: Letterbox, labels: list[int], task: Task, *, masks: bool
) -> Iterator[Detection]:
    """Yield objects that have rotated boxes, also as their masks if wanted, or keypoints; without names."""
    rotated = rotated_boxes(found, letterbox) if task.kind == "obb" else []
    keypoints = keypoints_of(found, letterbox, task) if task.kind == "pose" else []
    boxes = upright(rotated, letterbox) if rotated else _in_image(found.corners, letterbox)
    size = letterbox.rows.image, letterbox.columns.image
    encoded = encode_all(filled(rotated, boxes), *size) if masks and rotated else iter(())
    shapes = zip_longest(labels, found.scores.tolist(), boxes.tolist(), encoded, rotated, keypoints)
    for label, score, box, mask, turned, points in shapes:
        if box[0] < box[2] and box[1] < box[3]:
            about = {"mask": mask, "rotated": turned, "keypoints": points}
            yield Detection(name="", score=min(score, 1.0), box=Box(*box), label=label, **about)


def _classified(output: Output, letterbox: Letterbox, criteria: Criteria, names: Mapping[int, str]) -> list[Detection]:
    scores = output.predictions
    if scores.shape != (len(names),):
        raise OutputError(f"an output of {scores.shape} from a model of {len(names)} classes")
    whole = Box(0, 0, letterbox.columns.image, letterbox.rows.image)
    found: dict[str, Detection] = {}
    for label in sorted(_sure(scores, criteria).tolist(), key=lambda each: -scores[each]):
        needed = criteria.confidence if criteria.scores is None else criteria.scores[label]
        if scores[label] > needed and (criteria.labels is None or label in criteria.labels):
            name = names[label][:MAX_LABEL]
            found.setdefault(name, Detection(name=name, score=min(float(scores[label]), 1.0), box=whole, label=label))
    return list(found.values())[: criteria.max_detections]


def _judged(mask: Mask, quality: float) -> Mask:
    return msgspec.structs.replace(mask, quality=quality)


def _without_doubles(found: Candidates, criteria: Criteria, task: Task) -> NDArray[np.int64]:
    labels = np.zeros_like(found.labels) if criteria.agnostic else _classes(found, criteria)
    if task.kind == "obb":
        return rotated_suppressed(found, labels, criteria.iou, criteria.max_detections)
    return suppressed(found.corners, labels, criteria.iou, criteria.max_detections)


def _classes(found: Candidates, criteria: Criteria) -> NDArray[np.int64]:
    """Return the objects' labels, the same one for classes of the same name."""
    return found.labels if criteria.same is None else criteria.same[found.labels]


def _candidates(output: Output, letterbox: Letterbox, layout: _Layout, criteria: Criteria) -> Candidates:
    """Return the candidates of reported classes above the score threshold, best first."""
    found = _read(output, letterbox, layout, criteria)
    if not (np.isfinite(found.corners).all() and np.isfinite(found.coefficients).all()):
        raise OutputError("a box or a mask that is not a number")
    if criteria.labels is not None:
        found = found[np.isin(found.labels, criteria.labels)]
    if criteria.scores is not None:
        found = found[found.scores > criteria.scores[found.labels]]
    return found[np.argsort(-found.scores, kind="stable")[:MAX_CANDIDATES]]


def _read(output: Output, letterbox: Letterbox, layout: _Layout, criteria: Criteria) -> Candidates:
    classes, head = layout.classes, layout.head
    match output.predictions.shape:
        case (_, numbers) if head == "rt-detr" and numbers == ENDED:
            return _queries(output, letterbox, classes, criteria)
        case (_, _) if head != "rt-detr" and layout.is_dense(output):
            every = head == "nms-free" and not criteria.agnostic
            return _every_class(output, classes, criteria) if every else _best_class(output, classes, criteria)
        case (_, numbers) if head != "rt-detr" and numbers == ENDED + layout.extras(output):
            found = _ended(output, classes, criteria)
            return replace(found, corners=_corners(found.corners)) if layout.task.kind == "obb" else found
    raise OutputError(f"an output of {output.predictions.shape} from a model of {classes} classes")


def _best_class(output: Output, classes: int, criteria: Criteria) -> Candidates:
    scores = output.predictions[PLACES : PLACES + classes]
    sure = _sure(scores.max(axis=0), criteria)
    return _at(output, sure, np.asarray(scores[:, sure].argmax(axis=0), np.int64), classes)


def _every_class(output: Output, classes: int, criteria: Criteria) -> Candidates:
    """Return one candidate per class above the threshold at each place: the best, as many as Ultralytics takes."""
    scores = output.predictions[PLACES : PLACES + classes].reshape(-1)
    sure = _sure(scores, criteria)
    places = output.predictions.shape[1]
    most = min(max(criteria.max_detections, LEAST_LOOKED_AT), places)
    if len(sure) > most:
        sure = sure[np.argpartition(-scores[sure], most - 1)[:most]]
    labels, at = np.divmod(np.sort(sure), places)
    return _at(output, at, np.asarray(labels, np.int64), classes)


def _at(output: Output, places: NDArray[np.intp], labels: NDArray[np.int64], classes: int) -> Candidates:
    """Return the candidates at places of an output, of one class each."""
    chosen = np.ascontiguousarray(output.predictions[:, places].T, np.float32)
    scores = np.take_along_axis(chosen, PLACES + labels[:, None], axis=1)[:, 0]
    return Candidates(_corners(chosen), scores, labels, chosen[:, PLACES + classes :])


def _corners(rows: Floats) -> Floats:
    centres, halves = rows[:, :2], rows[:, 2:PLACES] / 2
    return np.concatenate([centres - halves, centres + halves], axis=1)


def _sure(scores: Floats, criteria: Criteria) -> NDArray[np.intp]:
    """Return which scores are high enough; raise for NaN, which says nothing of what is in view."""
    if np.isnan(scores).any():
        raise OutputError("a score that is not a number")
    return np.flatnonzero(scores > criteria.least_score)


def _ended(output: Output, classes: int, criteria: Criteria) -> Candidates:
    rows = np.asarray(output.predictions[_sure(output.predictions[:, PLACES], criteria)], np.float32)
    labels = rows[:, PLACES + 1].astype(np.int64)
    if np.any((labels < 0) | (labels >= classes)):
        raise OutputError(f"a class beyond the {classes} that the model has")
    return Candidates(rows[:, :PLACES], rows[:, PLACES], labels, rows[:, ENDED:])


def _queries(output: Output, letterbox: Letterbox, classes: int, criteria: Criteria) -> Candidates:
    found = _ended(output, classes, criteria)
    size = np.array([letterbox.columns.input, letterbox.rows.input] * 2, np.float32)
    return replace(found, corners=_corners(found.corners * size))


def _apart(
    found: Candidates, prototypes: Floats, letterbox: Letterbox, classes: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return which objects, best first, have a pixel and are not MOSTLY covered by better ones of their class."""
    height, width = prototypes.shape[1:]
    scale = np.array([width / letterbox.columns.input, height / letterbox.rows.input] * 2, np.float32)
    windows = np.clip(np.rint(found.corners * scale), 0, [width, height] * 2).astype(int).tolist()
    few = FEW * max(1.0, height * width / (letterbox.rows.image * letterbox.columns.image))
    covered: dict[int, NDArray[np.bool_]] = {}
    apart: list[int] = []
    for n, (label, (left, top, right, bottom)) in enumerate(zip(classes.tolist(), windows, strict=True)):
        window = (slice(top, bottom), slice(left, right))
        mask = np.einsum("c,chw->hw", found.coefficients[n], prototypes[:, *window]) > 0  # no BLAS, so no threads
        own = np.count_nonzero(mask)
        if own <= few and not _is_seen(found[n : n + 1], prototypes, letterbox):
            continue
        before = covered.setdefault(label, np.zeros((height, width), np.bool_))[window]
        if np.count_nonzero(mask & before) <= MOSTLY * own:
            before |= mask
            apart.append(n)
    return np.array(apart, np.int64)


def _is_seen(found: Candidates, prototypes: Floats, letterbox: Letterbox) -> bool:
    """Return whether the mask of the only object found has a pixel of the image."""
    (window,) = _windows(found.coefficients, _in_image(found.corners, letterbox), prototypes, letterbox)
    return bool(window.pixels.any())


def _in_image(corners: Floats, letterbox: Letterbox) -> Floats:
    across = letterbox.columns.to_image(corners[:, 0::2])
    down = letterbox.rows.to_image(corners[:, 1::2])
    return np.stack([across[:, 0], down[:, 0], across[:, 1], down[:, 1]], axis=1)


def _windows(coefficients: Floats, boxes: Floats, prototypes: Floats, letterbox: Letterbox) -> Iterator[Window]:
    """Return masks at image resolution: the weighted sum of prototypes, interpolated in the box, above zero."""
    rows, columns = Taps.of(letterbox.rows, prototypes.shape[1]), Taps.of(letterbox.columns, prototypes.shape[2])
    for weights, (left, top, right, bottom) in zip(coefficients, np.ceil(boxes).astype(int).tolist(), strict=True):
        high, down = rows.cut(top, bottom)
        wide, across = columns.cut(left, right)
        small = np.einsum("c,chw->hw", weights, prototypes[:, high, wide])  # no BLAS, so no threads
        logits = across.apply(down.apply(small).T)
        yield Window(top, left, (logits > 0).T)


def _fitted(boxes: Floats, windows: Iterator[Window]) -> Iterator[Window]:
    """Yield masks in memory-bounded groups, and shrink each box to its mask."""
    for box, window in zip(boxes, windows, strict=True):
        rows, columns = np.flatnonzero(window.pixels.any(axis=1)), np.flatnonzero(window.pixels.any(axis=0))
        if rows.size:
            box[0::2] = window.left + columns[0], window.left + columns[-1] + 1
            box[1::2] = window.top + rows[0], window.top + rows[-1] + 1
        yield window


def _refined(seen: CloseUps, odds: Floats, letterbox: Letterbox) -> Iterator[Window]:
    """Return masks at image resolution: the close-ups' log odds, interpolated, above zero."""
    for pixels, (left, top, right, bottom), found in zip(seen.pixels, seen.windows.tolist(), odds, strict=True):
        mask = found > 0
        own = own_parts(mask, pixels[..., BOX] > 0)
        small = found if own is mask else np.where(mask & ~own, NOTHING, found)
        upper, down = Taps.within(letterbox.rows, top, bottom, len(small))
        first, across = Taps.within(letterbox.columns, left, right, len(small))
        yield Window(upper, first, (across.apply(down.apply(small).T) > 0).T)
