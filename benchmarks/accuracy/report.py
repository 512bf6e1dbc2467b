"""Figures as they are printed. Pure."""

from typing import Any, Final

from benchmarks.accuracy.following import Followed, Tally
from benchmarks.targets import Targets, at_least
from services.training.evaluation.class_lists import ListFigures
from services.training.evaluation.precision import Precision
from services.training.evaluation.run import HeldOutScore

CONFIDENCES: Final = tuple(round(0.05 * step, 2) for step in range(1, 19))
TARGETS: Final = {"mask_map50": 0.90, "mask_map50_95": 0.65, "classes_exact": 0.95, "idf1": 0.85}


def report(score: HeldOutScore, followed: Followed, confidence: float) -> dict[str, Any]:
    """Return the figures, the class lists' at a detector's default confidence, and whether each target is met."""
    masks, lists = score.masks.figures(), score.lists.figures(confidence)
    found = {
        **_precision(masks.overall),
        "by_score": _precision(masks.by_score),
        "classes_exact": _rounded(lists.share),
        **_identities(followed.boxes),
        **{f"{name}_masks": value for name, value in _identities(followed.masks).items()},
        "drive_frames": followed.frames,
        "confidence": confidence,
        "per_class": {name: _precision(each) for name, each in masks.per_class.items()},
        "per_size": {name: _precision(each) for name, each in masks.per_size.items()},
        "wrong_pictures": _wrong(lists),
        "by_confidence": [_at(score.lists.figures(each)) for each in CONFIDENCES],
    }
    targets: Targets = {}
    for name, limit in TARGETS.items():
        targets |= at_least(found, name, limit)
    return {"targets": targets, **found}


def _identities(tally: Tally) -> dict[str, Any]:
    return {
        "idf1": _rounded(tally.identities.idf1),
        "idp": _rounded(tally.identities.idp),
        "idr": _rounded(tally.identities.idr),
        "id_switches": tally.identities.switches,
        "following": _following(tally),
    }


def _following(tally: Tally) -> dict[str, Any]:
    """Return what limits IDF1, in object-frames: what is not found, without a track, wrong, or of another identity."""
    found = tally.identities
    return {
        "asked_for": found.true,
        "detected": tally.detected,
        "tracked": found.matched,
        "rightly_tracked": found.rightly,
        "wrong_tracks": found.tracked - found.matched,
        "f1_without_identities": _rounded(found.matched_f1),
    }


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
