"""The model card that is written beside the weights."""

import platform
from importlib.metadata import version
from typing import Final

from services.simulator.training.evaluation import MATCHING_IOU, NEAR_AREA, NEAR_METRES, MaskFigures, NearFigures
from services.simulator.training.fitting import ARCHITECTURE
from services.simulator.training.metering import Effort
from services.simulator.training.settings import TrainingSettings
from services.simulator.world import CLASSES

PACKAGES: Final = ("ultralytics-opencv-headless", "torch", "numpy", "opencv-python-headless")


def model_card(settings: TrainingSettings, masks: MaskFigures, near: NearFigures, effort: Effort) -> str:
    """The card as Markdown."""
    return "\n\n".join(
        (
            f"# {settings.output.stem}: box, pallet, forklift",
            f"A nano instance segmentation model (`{ARCHITECTURE}`, {len(CLASSES)} classes, input {settings.imgsz} pixels "
            "on the longer side, half precision), trained from random weights on rendered pictures of simulated "
            "warehouses. Made, and this page written, by one command:",
            f"    {_command(settings)}",
            _about(settings, effort),
            "## On scenes that it was not trained on",
            _mask_table(settings, masks),
            _near_table(near),
            "## What it is not",
            "It has seen no photograph: every picture it knows was rendered from cuboids. How it does on a real camera is "
            "not measured; train on pictures of your own site before you rely on it. Objects that are far, small or mostly "
            "hidden are often missed. Things that it was never shown (people, cars, hand pallet trucks) may be taken for "
            "one of its three classes.",
            "Licence: AGPL-3.0-or-later, as the project and the architecture's definition in Ultralytics are.\n",
        )
    )


def _command(settings: TrainingSettings) -> str:
    options = {
        name: getattr(settings, name)
        for name, field in TrainingSettings.model_fields.items()
        if name not in {"output", "work_dir", "workers", "device"} and getattr(settings, name) != field.default
    }
    return " ".join(["fleetsight train", *(f"--{name} {value}" for name, value in options.items())])


def _about(settings: TrainingSettings, effort: Effort) -> str:
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return (
        f"- Seed {settings.seed}; {settings.images} images of 640x480, two of each scene, {settings.epochs} epochs, "
        f"batch {settings.batch}.\n"
        f"- The run took {effort.wall_s / 60:.0f} minutes and {effort.cpu_s / 60:.0f} minutes of processor time, "
        f"rendering and evaluation included, with {settings.workers} workers.\n"
        f"- Python {platform.python_version()}, {versions}."
    )


def _mask_table(settings: TrainingSettings, masks: MaskFigures) -> str:
    rows = "\n".join(f"| {name} | {masks.per_class.get(name, 0.0):.3f} |" for name in CLASSES)
    return (
        f"{settings.holdout} held-out images from random viewpoints, every object of at least 0.04 % of the image asked "
        f"for: mask mAP50 {masks.map50:.3f}, mask mAP50-95 {masks.map50_95:.3f}.\n\n| class | mask mAP50 |\n|---|---|\n{rows}"
    )


def _near_table(near: NearFigures) -> str:
    rows = "\n".join(
        f"| {name} | {near.objects.get(name, 0)} | {near.named.get(name, 0)} | {near.misnamed.get(name, 0)} |"
        for name in CLASSES
    )
    return (
        f"On drives through held-out scenes, objects whose visible part covers at least {NEAR_AREA:.0%} of the picture "
        f"within {NEAR_METRES:.0f} m: {near.share:.1%} were named right (a box of the right class with an IoU of at least "
        f"{MATCHING_IOU}).\n\n| class | near objects | named right | only named wrong |\n|---|---|---|---|\n{rows}"
    )
