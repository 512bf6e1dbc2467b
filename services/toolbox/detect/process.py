"""Detects the objects in one image."""

import asyncio
import sys
import tempfile
from pathlib import Path
from typing import Final

import msgspec

from bus import MAX_REQUEST_BYTES, RefusedError, RequestError, open_bus
from fleetsight.asking import ask_detectors
from gateway.ros1.tasks import to_the_end
from schemas.detections import Detection, Detections
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from schemas.printing import printable
from services.detector.model import ModelError
from services.detector.overlay import drawings, jpeg_of
from services.detector.pixels import to_bgr
from services.detector.requests import detect
from services.detector.runtime.loading import load_all
from services.detector.settings import DetectorSettings
from services.detector.stills import StillError, frame_of
from services.geometry.errors import MaskError
from services.toolbox.detect.settings import DetectSettings

FAILED: Final = 1
ANSWERED_BY: Final = "local"
LEAST: Final = 0.001
"""Score from which a model that found nothing tells whatever it takes to be possible."""

MOST_NAMED: Final = 5


async def run(settings: DetectSettings) -> int:
    """Run detection on the image; print the objects, or on stderr why it failed, and draw them. Return the exit code.

    The objects are printed even if they cannot be drawn, and a picture whose writing has begun is finished.
    """
    try:
        image = await asyncio.to_thread(settings.image.read_bytes)
        found = await (_locally(settings, image) if settings.local else _by_a_worker(settings, image))
    except (RequestError, SchemaError, StillError, OSError) as error:
        return _failed(f"{settings.image}: {error}" if isinstance(error, StillError | RefusedError) else str(error))
    sys.stdout.write(as_json(found) if settings.json_ else table(found))
    try:
        await to_the_end(asyncio.to_thread(_draw, found, image, settings.drawing))
    except (StillError, MaskError, OSError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        return _failed(f"{settings.drawing}: nothing is drawn: {why}")
    if not settings.json_:
        sys.stdout.write(f"drawn in {printable(str(settings.drawing))}\n")
    return 0


def _failed(reason: str) -> int:
    sys.stderr.write(f"fleetsight detect: {printable(' '.join(reason.split()))}\n")
    return FAILED


async def _locally(settings: DetectSettings, image: bytes) -> Detections:
    frame = await asyncio.to_thread(frame_of, image)  # a file that is no image costs nobody the loading of a model
    found = await _by_a_model(settings.of_model, frame)
    if not found.objects:
        anything = await _by_a_model(_asking_for_anything(settings.of_model), frame)
        sys.stderr.write(f"fleetsight detect: {_why_nothing(settings, anything)}\n")
    return found


async def _by_a_model(settings: DetectorSettings, frame: ImageFrame) -> Detections:
    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder:
        model = await asyncio.to_thread(load_all, settings, Path(folder))
        try:
            return await detect(model, ANSWERED_BY, frame)
        except ModelError as error:  # unlike one that cannot be loaded, no wrong setting
            raise RefusedError(str(error)) from error
        finally:
            model.close()


async def _by_a_worker(settings: DetectSettings, image: bytes) -> Detections:
    """Ask the fleet's workers, until `timeout_s` after the command began.

    Raises:
        StillError: the image is too large to be sent.
        RequestError: none answers, or the image is refused.
    """
    if len(image) > MAX_REQUEST_BYTES:
        limit = f"at most {MAX_REQUEST_BYTES} are sent to a worker"
        raise StillError(f"a file of {len(image)} bytes, {limit}; --local looks at it here")
    loop = asyncio.get_running_loop()
    until_s = loop.time() + settings.timeout_s
    async with open_bus(settings) as bus:
        return await ask_detectors(bus, image, settings.timeout_s, until_s=until_s)


def _draw(found: Detections, image: bytes, output: Path) -> None:
    """Write the image with the objects drawn over it.

    Raises:
        StillError: it cannot be decoded here.
        MaskError: a mask from the worker is damaged.
        OSError: the file cannot be written.
    """
    (drawn,) = drawings(to_bgr(frame_of(image)), found.objects, [True])
    output.write_bytes(jpeg_of(drawn))


def as_json(found: Detections) -> str:
    """Return Detections as a line of JSON."""
    return msgspec.json.encode(found).decode() + "\n"


def table(found: Detections) -> str:
    """Return a line per object, best score first, and the model and worker."""
    rows = [("object", "score", "left", "top", "right", "bottom"), *map(_row, found.objects)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(
            [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        )
        for row in rows
    ]
    about = f"{len(found.objects)} objects by {printable(f'{found.model} of {found.worker}')}"
    return "\n".join([*(lines if found.objects else []), about, ""])


def _row(found: Detection) -> tuple[str, ...]:
    box = found.box
    return (
        printable(found.name),
        f"{found.score:.2f}",
        *(str(round(edge)) for edge in (box.x1, box.y1, box.x2, box.y2)),
    )


def _asking_for_anything(settings: DetectorSettings) -> DetectorSettings:
    """Return the same settings with which a model tells whatever it takes to be possible, of any class."""
    return settings.model_copy(update={"confidence": LEAST, "class_confidence": [], "classes": [], "refine": False})


def _why_nothing(settings: DetectSettings, anything: Detections) -> str:
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
