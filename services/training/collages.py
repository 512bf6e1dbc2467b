"""Makes further pictures to train on out of photographs: their objects on other backgrounds, and empty plain pictures.

Photographs of a class often come from one place, and a model then learns the place. Objects cut out along their
polygons and pasted onto photographs without any of the classes (Ghiasi et al., "Simple Copy-Paste", 2021) have nothing
in common but themselves. Where a box alone is known, GrabCut (Rother et al., 2004) finds the outline. Plain pictures,
such as a covered lens gives, have nothing to be found in them.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.training.files import TrainingError, keep_file
from services.training.photographs import LabelledObject, Photograph

SOURCE: Final = "collage"
MOST_OBJECTS: Final = 4
TRIES: Final = 12
"""Places looked at for each object before it is left out."""

LEAST_SIDE: Final = 24
"""Shorter side, in pixels, of an object that is worth cutting out."""

SIDES: Final = (0.15, 0.7)
"""Longer side of a pasted object, as a share of the background's."""

MOST_STRETCHED: Final = 2.0
"""How much larger than in its photograph an object becomes, at most."""

FEATHER_PX: Final = 3
GRAB_CUT_SIDE: Final = 256
GRAB_CUT_ROUNDS: Final = 4
LEAST_FOUND: Final = 0.15
"""Smallest part of a box and its margin that an outline covers."""

PLAIN_SHARE: Final = 8
"""One plain picture for so many collages."""

PLAIN_SIZE: Final = (480, 640)
JPEG_QUALITY: Final = 90

_Image = NDArray[np.uint8]


def make_collages(folder: Path, photographs: Sequence[Photograph], count: int, seed: int) -> list[Photograph]:
    """Write `count` pictures into `folder`: objects of these photographs on those without any.

    Without an empty photograph there are none. Classes that a cut-out may show beside its own stay unknown.

    Raises:
        TrainingError: a photograph cannot be read, or a file cannot be written.
    """
    backgrounds = [each for each in photographs if each.empty]
    by_class: dict[int, list[tuple[Photograph, LabelledObject]]] = {}
    for photograph in photographs:
        for each in photograph.objects:
            by_class.setdefault(each.class_index, []).append((photograph, each))
    if not backgrounds or not by_class:
        return []
    random = np.random.default_rng([seed, 1])
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for number in range(count):
        image = _read(backgrounds[random.integers(len(backgrounds))].file)
        placed: list[LabelledObject] = []
        unknown: frozenset[int] = frozenset()
        for _ in range(random.integers(1, MOST_OBJECTS + 1)):
            candidates = by_class[sorted(by_class)[random.integers(len(by_class))]]  # each class as often
            photograph, cut_out = candidates[random.integers(len(candidates))]
            if (pasted := _paste(image, _read(photograph.file), cut_out, placed, random)) is not None:
                placed.append(pasted)
                unknown |= photograph.unknown if cut_out.box_only else frozenset()
        made.append(_kept(folder / f"{SOURCE}_{number:05d}.jpg", image, tuple(placed), unknown))
    return made


def make_plain(folder: Path, count: int, seed: int) -> list[Photograph]:
    """Write `count` empty pictures into `folder`: one colour, a gradient or blurred noise; one in three nearly black.

    Raises:
        TrainingError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng([seed, 2])
    return [_kept(folder / f"plain_{number:05d}.jpg", _plain(number, random), ()) for number in range(count)]


def _plain(number: int, random: np.random.Generator) -> _Image:
    height, width = PLAIN_SIZE
    brightest = 25 if number % 3 == 0 else 255
    first, last = random.uniform(0, brightest, (2, 3))
    if random.random() < 0.5:
        first = last = np.full(3, first.mean())  # grey
    share = np.linspace(0, 1, height if random.random() < 0.5 else width)
    ramp = first + (last - first) * share[:, None]
    image = np.broadcast_to(ramp[:, None] if len(share) == height else ramp[None], (height, width, 3)).copy()
    if random.random() < 0.5:
        coarse = random.normal(0, brightest / 6, (random.integers(2, 40), random.integers(2, 40)))
        image += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)[..., None]
    image += random.normal(0, random.uniform(0, 8), image.shape)  # the sensor's
    return image.clip(0, 255).astype(np.uint8)


def _paste(
    image: _Image,
    photograph: _Image,
    cut_out: LabelledObject,
    placed: Sequence[LabelledObject],
    random: np.random.Generator,
) -> LabelledObject | None:
    """Draw an object of a photograph into `image`, beside those placed already; return it with its new polygon."""
    size = np.array(photograph.shape[1::-1])
    polygon = cut_out.polygon * size
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    extent = high - low
    if extent.min() < LEAST_SIDE:
        return None
    height, width = image.shape[:2]
    wanted = random.uniform(*SIDES) * max(height, width) / extent.max()
    scale = min(wanted, MOST_STRETCHED, 0.95 * width / extent[0], 0.95 * height / extent[1])
    flip = -1 if random.random() < 0.5 else 1
    for _ in range(TRIES):
        corner = random.uniform((0, 0), (width, height) - extent * scale)
        shift = corner - low * scale if flip == 1 else corner + high * scale * (1, 0) - low * scale * (0, 1)
        matrix = np.array([[flip * scale, 0, shift[0]], [0, scale, shift[1]]])
        moved = replace(cut_out, polygon=(polygon @ matrix[:, :2].T + matrix[:, 2]) / (width, height))
        if not any(_overlap(moved.box, other.box) for other in placed):
            mask = _outline(photograph, low, high) if cut_out.box_only else _filled(photograph, polygon)
            _blend(image, photograph, mask, matrix, random.uniform(0.7, 1.3))
            return moved
    return None


def _filled(photograph: _Image, polygon: NDArray[np.float64]) -> _Image:
    mask = np.zeros(photograph.shape[:2], np.uint8)
    cv2.fillPoly(mask, [polygon.round().astype(np.int32)], 255)
    return mask


def _outline(photograph: _Image, low: NDArray[np.float64], high: NDArray[np.float64]) -> _Image:
    """Return the mask of the object that fills the box from `low` to `high`, in pixels, as GrabCut finds it."""
    margin = 0.2 * (high - low)
    left, top = np.maximum(low - margin, 0).astype(int)
    right, bottom = np.minimum(high + margin, photograph.shape[1::-1]).astype(int)
    part = photograph[top:bottom, left:right]
    scale = min(1.0, GRAB_CUT_SIDE / max(part.shape[:2]))
    small = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    (x, y), (width, height) = ((low - (left, top)) * scale).astype(int), ((high - low) * scale).astype(int)
    inside = (max(int(x), 1), max(int(y), 1), min(int(width), small.shape[1] - 3), min(int(height), small.shape[0] - 3))
    labels = np.zeros(small.shape[:2], np.uint8)
    cv2.setRNGSeed(1)
    cv2.grabCut(small, labels, inside, np.zeros((1, 65)), np.zeros((1, 65)), GRAB_CUT_ROUNDS, cv2.GC_INIT_WITH_RECT)
    found = ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)).astype(np.uint8) * 255
    if found.mean() < LEAST_FOUND * 255:  # much like its surroundings: the whole box
        found[inside[1] : inside[1] + inside[3], inside[0] : inside[0] + inside[2]] = 255
    mask = np.zeros(photograph.shape[:2], np.uint8)
    mask[top:bottom, left:right] = cv2.resize(found, part.shape[1::-1])
    return mask


def _blend(image: _Image, photograph: _Image, mask: _Image, matrix: NDArray[np.float64], light: float) -> None:
    height, width = image.shape[:2]
    moved = cv2.warpAffine(photograph, matrix, (width, height), flags=cv2.INTER_AREA)
    alpha = cv2.warpAffine(mask, matrix, (width, height))
    alpha = cv2.GaussianBlur(alpha, (FEATHER_PX, FEATHER_PX), 0)[..., None] / 255
    image[:] = (image * (1 - alpha) + (moved * light).clip(0, 255) * alpha).astype(np.uint8)


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _kept(
    file: Path, image: _Image, objects: tuple[LabelledObject, ...], unknown: frozenset[int] = frozenset()
) -> Photograph:
    encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    keep_file(file, encoded.tobytes())
    return Photograph(file, SOURCE, objects, unknown=unknown)


def _read(file: Path) -> _Image:
    try:
        image = cv2.imdecode(np.frombuffer(file.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    except (OSError, cv2.error) as error:
        raise TrainingError(
            f"{file}: {getattr(error, 'strerror', None) or 'not a picture that can be read'}"
        ) from error
    if image is None:
        raise TrainingError(f"{file}: not a picture that can be read")
    return np.asarray(image, np.uint8)
