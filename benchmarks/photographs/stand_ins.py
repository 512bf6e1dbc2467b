"""Rendered pictures in the form of labelled photographs, for runs without any."""

from pathlib import Path
from typing import Final

import cv2

from services.training.dataset import holdout_seed, views_of

PICTURES: Final = 6
SEED: Final = 1
FIRST: Final = 290_000
"""The number, among a run's held-out scenes, of the first that is used here alone."""


def write_stand_ins(folder: Path) -> Path:
    """Write a few held-out rendered pictures with their labels, and return the folder."""
    images, labels = folder / "val" / "images", folder / "val" / "labels"
    images.mkdir(parents=True)
    labels.mkdir(parents=True)
    for number in range(PICTURES):
        ((image, objects),) = views_of(holdout_seed(SEED, FIRST + number), 1)
        name = f"rendered_{number}"
        cv2.imwrite(str(images / f"{name}.jpg"), image[..., ::-1])
        height, width = image.shape[:2]
        lines = (
            f"{each.class_index} " + " ".join(f"{value:.5f}" for value in (each.polygon / (width, height)).ravel())
            for each in objects
        )
        (labels / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder
