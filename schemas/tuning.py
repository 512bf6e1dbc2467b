"""Tuning: the detection criteria of a detector's model."""

from typing import Annotated

import msgspec

from schemas.detections import MAX_DETECTIONS
from schemas.header import Label

Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]


class Tuning(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Detection criteria. In a request None leaves a value unchanged; an answer holds all of them.

    Unknown fields are rejected, so that a misspelt name is an error.

    confidence: only a higher score counts. iou: overlap (intersection over union) of two boxes of one class above which
    only the better one counts. max_detections: most objects per image. classes: the names that are reported; empty for
    all the model knows.
    """

    confidence: Fraction | None = None
    iou: Fraction | None = None
    max_detections: Annotated[int, msgspec.Meta(ge=1, le=MAX_DETECTIONS)] | None = None
    classes: Annotated[list[Label], msgspec.Meta(max_length=MAX_DETECTIONS)] | None = None
