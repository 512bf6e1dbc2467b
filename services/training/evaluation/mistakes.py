"""A page of a model's mistakes on photographs: which classes it confuses, and the pictures with most mistakes."""

import base64
import heapq
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import count
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from services.simulator.world import CLASSES
from services.training.evaluation.near_objects import MATCHING_IOU, box_iou
from services.training.evaluation.photographs import PhotographScore
from services.training.evaluation.predictor import CONFIDENCE
from services.training.photographs import Photograph

SHOWN: Final = 24
"""Pictures on the page."""

WIDTH: Final = 480
"""Of a picture on the page, in pixels."""

QUALITY: Final = 80
NOTHING: Final = "nothing"
LABEL: Final = (0, 114, 178)
PREDICTION: Final = (230, 159, 0)
"""Colours (RGB) that are told apart by those who see no red or no green, too."""

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """A labelled object and the prediction at its place; None where there is only one of them.

    box: the label's, else the prediction's, in pixels: left, top, right, bottom.
    """

    labelled: str | None
    predicted: Detection | None
    box: NDArray[np.float64]

    @property
    def right(self) -> bool:
        return self.predicted is not None and self.predicted.name == self.labelled


def pairs(
    photograph: Photograph, found: Sequence[Detection], width: int, height: int, classes: Sequence[str] = CLASSES
) -> Iterator[Pair]:
    """Yield all labels and predictions of a picture in pairs, one to one; first the predictions, the best scores first.

    A prediction belongs to a label that it overlaps with an IoU of at least MATCHING_IOU, before all to one of its own
    class. Those alone that are of a class that the picture's source does not know are left out: they may be right.
    """
    scale = np.array((width, height, width, height))
    unknown = {classes[index] for index in photograph.unknown}
    left = [(classes[each.class_index], np.array(each.box) * scale) for each in photograph.objects]
    for each in found:
        box = np.array((each.box.x1, each.box.y1, each.box.x2, each.box.y2))
        near = [(name == each.name, box_iou(box, at), place) for place, (name, at) in enumerate(left)]
        if near := [entry for entry in near if entry[1] >= MATCHING_IOU]:
            name, at = left.pop(max(near)[2])
            yield Pair(name, each, at)
        elif each.name in classes and each.name not in unknown:
            yield Pair(None, each, box)
    for name, at in left:
        yield Pair(name, None, at)


@dataclass(order=True, slots=True)
class _Kept:
    """A picture for the page. number: the first of two that are as bad counts as worse."""

    mistakes: int
    number: int
    name: str = field(compare=False)
    told: str = field(compare=False)
    jpeg: bytes = field(compare=False)


class Mistakes:
    """Gathers what was wrong in each picture; keeps the worst pictures. classes: in the order of their indices."""

    def __init__(self, classes: Sequence[str] = CLASSES, shown: int = SHOWN) -> None:
        self._classes = classes
        self.confusion: Counter[tuple[str, str]] = Counter()
        self._shown = shown
        self._worst: list[_Kept] = []
        self._numbers = count(0, -1)

    def add(self, photograph: Photograph, image: Pixels, found: Sequence[Detection]) -> None:
        """Take in one picture (height x width x 3, RGB) with its predictions, the best scores first."""
        height, width = image.shape[:2]
        all_pairs = list(pairs(photograph, found, width, height, self._classes))
        self.confusion.update((each.labelled or NOTHING, _named(each.predicted)) for each in all_pairs)
        wrong = [each for each in all_pairs if not each.right]
        if not wrong or (len(self._worst) == self._shown and len(wrong) <= self._worst[0].mistakes):
            return
        told = "; ".join(f"{number} x {text}" for text, number in Counter(map(_in_words, wrong)).items())
        kept = _Kept(len(wrong), next(self._numbers), photograph.file.name, told, _drawn(image, wrong))
        (heapq.heappush if len(self._worst) < self._shown else heapq.heapreplace)(self._worst, kept)

    def page(self, title: str, scores: Mapping[str, PhotographScore]) -> str:
        """Return the page as HTML with everything in it. scores: of the same pictures, by source."""
        figures = [
            (source, name, score.labelled, _share(score.recall), _share(score.precision))
            for source, of_source in sorted(scores.items())
            for name, score in of_source.classes.items()
            if score.labelled
        ]
        predicted = (*self._classes, NOTHING)
        cells: dict[tuple[str, str], object] = {**self.confusion, (NOTHING, NOTHING): ""}
        confused = [(labelled, *(cells.get((labelled, name), 0) for name in predicted)) for labelled in predicted]
        return _PAGE.format(
            title=escape(title),
            confidence=CONFIDENCE,
            iou=MATCHING_IOU,
            nothing=NOTHING,
            figures=_table(("source", "class", "labelled", "recall", "precision"), figures),
            confusion=_table(("labelled as", *(f"predicted {name}" for name in predicted)), confused),
            pictures="\n".join(map(_figure, sorted(self._worst, reverse=True))) or "<p>It made no mistake in them.</p>",
        )


def _named(found: Detection | None) -> str:
    return NOTHING if found is None else found.name


def _in_words(pair: Pair) -> str:
    if pair.predicted is None:
        return f"{pair.labelled} missed"
    return f"{pair.predicted.name} where {pair.labelled or NOTHING} is"


def _drawn(image: Pixels, wrong: Iterable[Pair]) -> bytes:
    """Return the picture as JPEG, with labels and predictions that are wrong drawn on it."""
    scale = WIDTH / image.shape[1]
    small = cv2.resize(image, (WIDTH, max(1, round(image.shape[0] * scale))), interpolation=cv2.INTER_AREA)
    for each in wrong:
        left, top, right, bottom = (each.box * scale).round().astype(int).tolist()
        colour = LABEL if each.predicted is None else PREDICTION
        text = f"{each.labelled}" if each.predicted is None else f"{each.predicted.name} {each.predicted.score:.2f}"
        cv2.rectangle(small, (left, top), (right, bottom), colour, 2)
        at = (max(left, 0) + 2, max(top, 0) + 14)
        cv2.putText(small, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 3, cv2.LINE_AA)
        cv2.putText(small, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return jpeg.tobytes()


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"


def _table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    head = "".join(f'<th scope="col">{escape(each)}</th>' for each in heads)
    body = "\n".join(
        f'<tr><th scope="row">{first}</th>{"".join(f"<td>{each}</td>" for each in others)}</tr>'
        for first, *others in (map(escape, map(str, row)) for row in rows)
    )
    return f"<table>\n<tr>{head}</tr>\n{body}\n</table>"


def _figure(kept: _Kept) -> str:
    picture = base64.b64encode(kept.jpeg).decode()
    said = escape(f"{kept.name}: {kept.told}")
    return f'<figure><img alt="{said}" src="data:image/jpeg;base64,{picture}"><figcaption>{said}</figcaption></figure>'


_PAGE: Final = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}: mistakes on photographs</title>
<style>
:root {{ color-scheme: light dark }}
body {{ font: 1rem/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem }}
table {{ border-collapse: collapse; margin: 1rem 0 }}
th, td {{ border: 1px solid; padding: 0.2rem 0.6rem; text-align: right }}
th[scope=row] {{ text-align: left }}
main {{ display: grid; gap: 1rem; grid-template-columns: repeat(auto-fill, minmax(20rem, 1fr)) }}
figure {{ margin: 0 }}
img {{ height: auto; max-width: 100% }}
</style>
</head>
<body>
<h1>{title}: mistakes on photographs</h1>
<p>On the photographs to test on, at a confidence of {confidence:.2f}. A prediction and a label are one object where
their boxes overlap with an IoU of at least {iou:.1f}. Predictions alone of a class that a picture's source does not
label are left out.</p>
<h2>Figures</h2>
{figures}
<h2>Confusion</h2>
<p>Objects by their label and by what the model took them for. "{nothing}" in a row: there is no such object; in a
column: it was missed.</p>
{confusion}
<h2>The pictures with most mistakes</h2>
<p>Mistakes alone are drawn: in blue labelled objects that were missed, in orange wrong predictions with their
scores.</p>
<main>
{pictures}
</main>
</body>
</html>
"""
