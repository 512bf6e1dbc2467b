"""Says why a model found nothing: what it was least unsure of, and which settings that did not meet. Pure."""

from typing import Final

from schemas.detections import Detections
from schemas.printing import printable
from services.detector.settings import DetectorSettings
from services.toolbox.detect.settings import DetectSettings

LEAST: Final = 0.001
MOST_NAMED: Final = 5


def asking_for_anything(settings: DetectorSettings) -> DetectorSettings:
    """Return the same settings with which a model tells whatever it takes to be possible, of any class."""
    return settings.model_copy(update={"confidence": LEAST, "class_confidence": [], "classes": [], "refine": False})


def why_nothing(settings: DetectSettings, anything: Detections) -> str:
    """Return in one line why nothing was found. anything: what the model finds when asked for anything."""
    best: dict[str, float] = {}
    for found in anything.objects:
        best[found.name] = max(best.get(found.name, 0.0), found.score)
    size = f"an image of {anything.width} x {anything.height} pixels"
    if settings.image_size:
        size += f", scaled to {settings.image_size} (--image-size)"
    if not best:
        return f"nothing found, however unsure, in {size}: does the model know what is in it?"
    likeliest = sorted(best.items(), key=lambda each: -each[1])[:MOST_NAMED]
    said = ", ".join(f"{printable(name)} {_against(settings, name, score)}" for name, score in likeliest)
    return f"nothing found in {size}; the best scores are {said}"


def _against(settings: DetectSettings, name: str, score: float) -> str:
    """Return a score, and the setting that keeps it from being reported."""
    if settings.classes and name not in settings.classes:
        return f"{score:.2f} (not among --classes)"
    needed = settings.confidences.get(name)
    if needed is not None:
        return f"{score:.2f} (--class-confidence {needed:g})"
    return f"{score:.2f} (--confidence {settings.confidence:g})"
