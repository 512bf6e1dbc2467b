"""Finds objects by a bare call of Ultralytics, and compares what is found with them, box by box."""

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float64]
"""Objects, best score first, each as left, top, right, bottom, score, class."""

SIDE: Final = 128


def picture(height: int = 90, width: int = 150) -> NDArray[np.uint8]:
    coarse = np.random.default_rng(3).integers(0, 255, (9, 14, 3), np.uint8)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


def built_file(architecture: str, files: dict[str, Path], head: str = "") -> Path:
    """Return a model file of an architecture with this head, built if there is none yet. files: see the fixture."""
    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - after `keep_offline`

    if architecture not in files:
        model = built_models.build(architecture)
        assert head in ("", type(model.model[-1]).__name__)
        files[architecture] = built_models.write(model, files[""] / architecture.replace(".yaml", "-built.pt"))
    return files[architecture]


def bare(file: Path, image: NDArray[np.uint8], **options: object) -> Rows:
    """Return what Ultralytics finds, cut at the image's border as RT-DETR's boxes alone are not."""
    from ultralytics.models import YOLO  # noqa: PLC0415 - it must be offline by then

    model: Any = YOLO(file)
    chosen = {"imgsz": SIDE, "device": "cpu", "verbose": False, "retina_masks": True, **options}
    (found,) = model.predict(image, **chosen)
    rows: Rows = found.boxes.data.double().numpy()
    height, width = image.shape[:2]
    rows[:, :4] = np.clip(rows[:, :4], 0, [width, height] * 2)
    return rows


def vars_of(box: Any) -> tuple[float, float, float, float]:
    return box.x1, box.y1, box.x2, box.y2


def nearest(found: Rows, expected: Rows, *, pixels: float, score: float) -> tuple[NDArray[np.intp], Rows]:
    """Return for each object which of those expected is most like it, and how unlike, at most 1 of the same class."""
    apart = (np.abs(found[:, None] - expected) / np.array([pixels] * 4 + [score, 0.5])).max(axis=2)
    return apart.argmin(axis=1), apart.min(axis=1)


def check_same(found: Rows, expected: Rows) -> None:
    """Assert that each object is that of the same class, score and place; equal scores have no order."""
    assert len(found) == len(expected) >= 2
    which, apart = nearest(found, expected, pixels=0.1, score=1e-4)
    assert sorted(which) == list(range(len(expected)))
    assert apart.max() < 1
