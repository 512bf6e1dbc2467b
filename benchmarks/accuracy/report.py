"""Figures as they are printed. Pure."""

from typing import Any, Final

from services.simulator.training.evaluation.class_lists import ListFigures
from services.simulator.training.evaluation.held_out import HeldOutScore
from services.simulator.training.evaluation.precision import Precision

CONFIDENCES: Final = tuple(round(0.05 * step, 2) for step in range(1, 19))
TARGETS: Final = {"mask_map50": 0.90, "mask_map50_95": 0.65, "classes_exact": 0.95}


def report(score: HeldOutScore, confidence: float) -> dict[str, Any]:
    """Return the figures, the class lists' at a detector's default confidence, and whether each target is met."""
    masks, lists = score.masks.figures(), score.lists.figures(confidence)
    found = {
        **_precision(masks.overall),
        "classes_exact": _rounded(lists.share),
        "confidence": confidence,
        "per_class": {name: _precision(each) for name, each in masks.per_class.items()},
        "per_size": {name: _precision(each) for name, each in masks.per_size.items()},
        "wrong_pictures": _wrong(lists),
        "by_confidence": [_at(score.lists.figures(each)) for each in CONFIDENCES],
    }
    return {"targets": {name: _target(found[name], limit) for name, limit in TARGETS.items()}, **found}


def _target(value: float | None, limit: float) -> dict[str, Any]:
    return {"value": value, "at_least": limit, "met": value is not None and value >= limit}


def _precision(precision: Precision) -> dict[str, Any]:
    return {
        "mask_map50": _rounded(precision.map50),
        "mask_map50_95": _rounded(precision.map50_95),
        "truths": precision.truths,
    }


def _at(lists: ListFigures) -> dict[str, Any]:
    return {"confidence": lists.confidence, "classes_exact": _rounded(lists.share), **_wrong(lists)}


def _wrong(lists: ListFigures) -> dict[str, dict[str, int]]:
    return {"missed": lists.missed, "invented": lists.invented}


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
