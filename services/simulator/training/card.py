"""The model card that is written beside the weights."""

import platform
from importlib.metadata import version
from typing import Final

from services.simulator.training.evaluation import (
    CONFIDENCE,
    MATCHING_IOU,
    NEAR_AREA,
    NEAR_METRES,
    MaskFigures,
    NearFigures,
)
from services.simulator.training.fitting import ARCHITECTURE
from services.simulator.training.metering import Effort
from services.simulator.training.settings import TrainingSettings
from services.simulator.world import CLASSES

PACKAGES: Final = ("ultralytics-opencv-headless", "torch", "numpy", "opencv-python-headless")

_CARD: Final = """\
# {name}: box, pallet, forklift

A nano instance segmentation model (`{architecture}`, {classes} classes, input {imgsz} pixels on the longer side, half
precision), trained from random weights on rendered pictures of simulated warehouses. Made, and this page written, by
one command:

    {command}

- Seed {seed}; {images} images of 640x480, two of each scene, {epochs} epochs, batch {batch}.
- The run took {wall_min:.0f} minutes by the clock and {cpu_min:.0f} minutes of processor time on {workers} workers,
  rendering included.
- Python {python}, {versions}.

## On scenes that it was not trained on

{holdout} held-out images from random viewpoints, every object of at least 0.04 % of the image asked for: mask mAP50
{map50:.3f}, mask mAP50-95 {map50_95:.3f}.

| class | mask mAP50 |
|---|---|
{mask_rows}

On drives through held-out scenes, of the objects whose visible part covers at least {near_area:.0%} of the picture
within {near_metres:.0f} m, {near_share:.1%} were named right: a box of the right class with an IoU of at least
{iou:.1f}, at a confidence of at least {confidence:.2f}.

| class | near objects | named right | only named wrong | invented |
|---|---|---|---|---|
{near_rows}

"Invented" are predictions of at least the same size in these {pictures} pictures where nothing of that class was.

## What it is not

It has seen no photograph: every picture it knows was rendered from cuboids. How it does on a real camera is not
measured; train on pictures of your own site before you rely on it. Objects that are far, small or mostly hidden are
often missed, and trolleys, posts or bare walls are sometimes taken for forklifts. Things that it was never shown
(people, cars, hand pallet trucks) may be taken for one of its classes.

Licence: AGPL-3.0-or-later, as the project and the architecture's definition in Ultralytics are.
"""


def model_card(settings: TrainingSettings, masks: MaskFigures, near: NearFigures, effort: Effort) -> str:
    """Describe a run's weights as Markdown."""
    return _CARD.format(
        name=settings.output.stem,
        architecture=ARCHITECTURE,
        classes=len(CLASSES),
        command=_command(settings),
        wall_min=effort.wall_s / 60,
        cpu_min=effort.cpu_s / 60,
        python=platform.python_version(),
        versions=", ".join(f"{name} {version(name)}" for name in PACKAGES),
        map50=masks.map50,
        map50_95=masks.map50_95,
        mask_rows="\n".join(f"| {name} | {masks.per_class.get(name, 0.0):.3f} |" for name in CLASSES),
        near_area=NEAR_AREA,
        near_metres=NEAR_METRES,
        near_share=near.share,
        pictures=near.pictures,
        iou=MATCHING_IOU,
        confidence=CONFIDENCE,
        near_rows="\n".join(_near_row(near, name) for name in CLASSES),
        **settings.model_dump(include={"imgsz", "seed", "images", "epochs", "batch", "workers", "holdout"}),
    )


def _command(settings: TrainingSettings) -> str:
    asked = {"seed", "images", "holdout", "coarse_epochs", "epochs", "imgsz", "batch"}
    options = settings.model_dump(include=asked, exclude_defaults=True)
    return " ".join(["fleetsight train", *(f"--{name.replace('_', '-')} {value}" for name, value in options.items())])


def _near_row(near: NearFigures, name: str) -> str:
    counts = (figures.get(name, 0) for figures in (near.objects, near.named, near.misnamed, near.invented))
    return f"| {name} | " + " | ".join(str(count) for count in counts) + " |"
