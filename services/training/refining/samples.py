"""Training samples of a refiner: close-ups of objects that the model finds, and their true masks."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.world import CLASSES, SeenObject
from services.training import parallel
from services.training.dataset import MIN_AREA, VIEWS, pictures_of, training_seed
from services.training.files import keep_file
from services.training.parallel import Progress
from services.training.refining.refinement import Looks, Refinement

MIN_IOU: Final = 0.25
"""Minimum IoU of a coarse mask with an object for it to be the object found."""

NO_IOU: Final = 0.1
"""Maximum IoU of a coarse mask with every object of its class for it to be a false detection."""

MIN_VISIBILITY: Final = 0.3
"""Minimum visible share of an object to learn from: the rest of a more hidden one says little of its outline."""

SEEN: Final = ("pixels", "features", "labels", "scores")
"""The fields of `Looks` in a sample."""

Bytes = NDArray[np.uint8]
Records = NDArray[np.void]
"""Samples, with the fields of `SEEN`, and targets: true masks, side x side, 255 where all of a pixel is the object's,
and 0 everywhere where there is no such object."""


class Samples:
    """Samples in files, read on each access: together they may exceed the memory.

    labels: of all of them.
    """

    def __init__(self, files: Sequence[Path]) -> None:
        parts = [np.array(_opened(file)["labels"], np.int64) for file in files]
        self.labels: NDArray[np.int64] = np.concatenate([np.empty(0, np.int64), *parts])
        self._files = files
        self._begins = np.cumsum([0, *map(len, parts)])

    def take(self, chosen: NDArray[np.int64]) -> Records:
        """Read the samples of these indices, of which there is at least one."""
        files = np.searchsorted(self._begins, chosen, side="right") - 1
        return np.stack([_opened(self._files[k])[n - self._begins[k]] for k, n in zip(files, chosen, strict=True)])


def _opened(file: Path) -> Records:
    return np.asarray(np.load(file, mmap_mode="r"))


@dataclass(frozen=True, slots=True)
class _Job:
    file: Path
    seed: int
    refinement: Refinement
    weights: Path
    device: str
    folder: Path


def write_samples(
    folder: Path,
    refinement: Refinement,
    weights: Path,
    seeds: Sequence[int],
    *,
    device: str,
    workers: int,
    progress: Progress,
) -> list[Path]:
    """Run `weights` on `VIEWS` images of each scene; return files of samples, which are kept for later runs."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{seed:09d}.npy" for seed in seeds]
    jobs = [
        _Job(file, seed, refinement, weights, device, folder)
        for file, seed in zip(files, seeds, strict=True)
        if not file.exists()
    ]
    before = len(seeds) - len(jobs)
    progress("look", before, len(seeds))
    parallel.run(_write, jobs, workers, lambda done: progress("look", before + done, len(seeds)))
    return files


def refining_seeds(seed: int, images: int, refiner_images: int) -> list[int]:
    """The scenes to use: those after the training's, on which the model performs as on any other."""
    first = -(-images // VIEWS)
    return [training_seed(seed, first + index) for index in range(-(-refiner_images // VIEWS))]


def _write(job: _Job) -> None:
    look = job.refinement.open(job.weights, job.device, job.folder)
    stretched = job.refinement.stretched
    parts = [matched(look(image), truths, stretched) for image, truths in pictures_of(job.seed, VIEWS)]
    found = [part for part in parts if len(part)]  # parts without objects may have another shape
    content = io.BytesIO()
    np.save(content, np.concatenate(found) if found else parts[0])
    keep_file(job.file, content.getvalue())


def matched(looks: Looks, truths: Sequence[SeenObject], stretched: Callable[[Bytes], Bytes]) -> Records:
    """Match each close-up to its object, or to none; doubtful ones and those that show little are left out."""
    whole = [looks.letterboxed(np.where(truth.full_mask(), np.uint8(255), np.uint8(0))) for truth in truths]
    side = looks.pixels.shape[1]
    learned: list[int] = []
    targets: list[Bytes] = []
    for n, (left, top, right, bottom) in enumerate(looks.windows.tolist()):
        cuts = [each[top:bottom, left:right] for each in whole]
        own = [k for k, cut in enumerate(cuts) if truths[k].name == CLASSES[looks.labels[n]] and cut.any()]
        masks = {k: stretched(cuts[k]) for k in own}
        overlaps = {k: _iou(mask > 127, looks.masks[n]) for k, mask in masks.items()}
        best = max(own, key=overlaps.__getitem__, default=None)
        if best is None or overlaps[best] < NO_IOU:
            learned.append(n)
            targets.append(np.zeros((side, side), np.uint8))
        elif overlaps[best] >= MIN_IOU and _shows_enough(truths[best]):
            learned.append(n)
            targets.append(masks[best])
    fields: dict[str, NDArray[Any]] = {name: getattr(looks, name)[learned] for name in SEEN}
    fields["targets"] = np.array(targets, np.uint8).reshape(len(learned), side, side)
    records = np.empty(len(learned), [(name, each.dtype, each.shape[1:]) for name, each in fields.items()])
    for name, each in fields.items():
        records[name] = each
    return records


def _shows_enough(truth: SeenObject) -> bool:
    return truth.image_share >= MIN_AREA and truth.visibility >= MIN_VISIBILITY


def _iou(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    shared, either = int(np.count_nonzero(one & other)), int(np.count_nonzero(one | other))
    return shared / max(1, either)
