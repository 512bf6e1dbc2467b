"""Makes a YOLO segmentation data set from the simulated warehouse."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.data_folder import description_of
from services.geometry.outlines import Polygon, outline
from services.simulator.world import CLASSES, SeenObject, Sensor, expose, generate, truth_of
from services.simulator.world.clearance import Clearance
from services.training import parallel
from services.training.files import keep_file
from services.training.parallel import Progress
from services.training.viewpoints import draw_view

VIEWS: Final = 2
SEEDS_PER_RUN: Final = 1_000_000
HOLDOUT_OFFSET: Final = 500_000
MIN_AREA: Final = 0.0004
MIN_SIDE: Final = 5
NO_NEW_NAMES: Final[Mapping[str, str]] = MappingProxyType({})
WORLDS_NUMBERS: Final[Mapping[str, int]] = MappingProxyType({name: number for number, name in enumerate(CLASSES)})


@dataclass(frozen=True, slots=True)
class Label:
    """One object in a picture: its class's index and its polygon in pixels."""

    class_index: int
    polygon: Polygon


def training_seed(seed: int, index: int) -> int:
    """The scene seed of training scene `index` of a run."""
    return seed * SEEDS_PER_RUN + index


def holdout_seed(seed: int, index: int) -> int:
    """The scene seed of held-out scene `index`: never one of the training scenes of the same run."""
    return seed * SEEDS_PER_RUN + HOLDOUT_OFFSET + index


def write_dataset(
    folder: Path,
    progress: Progress,
    *,
    seed: int,
    images: int,
    holdout: int,
    workers: int,
    classes: Sequence[str] = CLASSES,
    new_names: Mapping[str, str] = NO_NEW_NAMES,
) -> Path:
    """Write both splits and return the path of the data set's YAML; existing scenes are kept.

    classes: names by number in the labels. new_names: of the world's classes, where they have others there; objects of
    a class that is not among them get no label.
    """
    numbers = numbers_of(classes, new_names)
    jobs = [
        (folder, split, seed_of(seed, index), min(VIEWS, count - index * VIEWS), numbers)
        for split, count, seed_of in (("train", images, training_seed), ("val", holdout, holdout_seed))
        for index in range(-(-count // VIEWS))
    ]
    for split in ("train", "val"):
        for kind in ("images", "labels"):
            (folder / kind / split).mkdir(parents=True, exist_ok=True)
    progress("render", 0, len(jobs))
    parallel.run(_write_scene, jobs, workers, lambda done: progress("render", done, len(jobs)))
    description = folder / "dataset.yaml"
    told = description_of(classes, path=str(folder.resolve()), train="images/train", val="images/val")
    keep_file(description, told)
    return description


def rendered(dataset: Path) -> list[Path]:
    """Return the pictures to train on of a data set that `write_dataset` made, in the order of their names."""
    return sorted((dataset.parent / "images" / "train").glob("*.png"))


def numbers_of(classes: Sequence[str], new_names: Mapping[str, str] = NO_NEW_NAMES) -> dict[str, int]:
    """Return the numbers of the world's classes among others, by the world's names; see `write_dataset`."""
    named = {name: new_names.get(name, name) for name in CLASSES}
    return {name: classes.index(new) for name, new in named.items() if new in classes}


def _write_scene(job: tuple[Path, str, int, int, Mapping[str, int]]) -> None:
    """Write the views of one scene; the label file comes last and marks its view as complete."""
    folder, split, seed, views, numbers = job
    names = [f"{seed:09d}-{view}" for view in range(views)]
    if all((folder / "labels" / split / f"{name}.txt").exists() for name in names):
        return
    for name, (image, labels) in zip(names, views_of(seed, views, numbers), strict=True):
        _, png = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
        keep_file(folder / "images" / split / f"{name}.png", png.tobytes())
        height, width = image.shape[:2]
        lines = (_line(label, width, height) for label in labels)
        keep_file(folder / "labels" / split / f"{name}.txt", "".join(lines).encode())


def views_of(
    seed: int, count: int, numbers: Mapping[str, int] = WORLDS_NUMBERS
) -> Iterator[tuple[NDArray[np.uint8], list[Label]]]:
    """`count` pictures (RGB) of the scene of `seed` with their labels. numbers: of classes, by the world's names."""
    for image, truths in pictures_of(seed, count):
        yield image, labels_of(truths, numbers)


def pictures_of(seed: int, count: int) -> Iterator[tuple[NDArray[np.uint8], tuple[SeenObject, ...]]]:
    """`count` images (RGB) of the scene of `seed` with ground truth."""
    scene, rng = generate(seed), np.random.default_rng([seed, 2])
    clearance = Clearance.of(scene)
    for _ in range(count):
        view = draw_view(scene, clearance, rng)
        truths = truth_of(scene, view.rendering, view.pose, view.camera)
        yield expose(view.rendering.color, Sensor.draw(rng), rng), truths


def labels_of(objects: Iterable[SeenObject], numbers: Mapping[str, int] = WORLDS_NUMBERS) -> list[Label]:
    """The objects in an image that have a number and are large enough to count."""
    labels = []
    for seen in objects:
        if seen.name not in numbers:
            continue
        polygon = outline(seen.mask.astype(np.uint8)) if seen.image_share >= MIN_AREA else None
        if polygon is not None and np.ptp(polygon, axis=0).min() >= MIN_SIDE:
            labels.append(Label(numbers[seen.name], np.add(polygon, (seen.left, seen.top))))
    return labels


def _line(label: Label, width: int, height: int) -> str:
    points = (label.polygon + 0.5) / (width, height)
    return f"{label.class_index} " + " ".join(f"{value:.5f}" for value in points.ravel()) + "\n"
