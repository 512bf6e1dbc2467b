"""What a refiner learns from: close-ups of what the model finds in scenes, and the true masks in them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.training import pool
from services.simulator.training.dataset import MIN_AREA, VIEWS, pictures_of, training_seed
from services.simulator.training.progress import Progress
from services.simulator.training.refining.refinement import Looks, Refinement
from services.simulator.world import CLASSES, SeenObject

MIN_IOU: Final = 0.25
"""Of a coarse mask with an object, for the object to be what was found."""

MIN_VISIBILITY: Final = 0.3
"""Of an object that is learned from: what is left of one that is more hidden says little of its outline."""

Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What to learn from.

    pixels, features, labels: see `Looks`. targets: true masks, objects x side x side, 255 where all of a pixel is.
    """

    pixels: Bytes
    features: NDArray[np.float16]
    labels: NDArray[np.int64]
    targets: Bytes

    @classmethod
    def joined(cls, parts: Sequence["Samples"]) -> "Samples":
        """Join those of many pictures."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__))

    def write(self, file: Path) -> None:
        """Write a file, whole or not at all."""
        partial = file.with_suffix(".part")
        with partial.open("wb") as stream:
            np.savez(stream, **{name: getattr(self, name) for name in self.__slots__})
        partial.replace(file)

    @classmethod
    def read(cls, files: Sequence[Path]) -> "Samples":
        """Read what `write` wrote to these files, at least one, in no more memory than that takes: it may be much."""
        ends = np.cumsum([len(_array(file, "labels")) for file in files]).tolist()
        return cls(*(_filled(files, name, ends) for name in cls.__slots__))


def _filled(files: Sequence[Path], name: str, ends: Sequence[int]) -> NDArray[Any]:
    """Read an array's parts, of which each ends at one of `ends`."""
    first = _array(files[0], name)
    whole = np.empty((ends[-1], *first.shape[1:]), first.dtype)
    for file, begin, end in zip(files, [0, *ends], ends, strict=False):
        whole[begin:end] = _array(file, name)
    return whole


def _array(file: Path, name: str) -> NDArray[Any]:
    with np.load(file) as arrays:
        return np.asarray(arrays[name])


@dataclass(frozen=True, slots=True)
class _Job:
    file: Path
    seed: int
    refinement: Refinement
    weights: Path
    folder: Path


def write_samples(
    folder: Path, refinement: Refinement, weights: Path, seeds: Sequence[int], *, workers: int, progress: Progress
) -> list[Path]:
    """Look at `VIEWS` pictures of each scene with `weights`; return files of samples, which are kept for later runs."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{seed:09d}.npz" for seed in seeds]
    jobs = [
        _Job(file, seed, refinement, weights, folder)
        for file, seed in zip(files, seeds, strict=True)
        if not file.exists()
    ]
    before = len(seeds) - len(jobs)
    progress("look", before, len(seeds))
    for done, _ in enumerate(pool.done(_write, jobs, workers), start=before + 1):
        progress("look", done, len(seeds))
    return files


def refining_seeds(seed: int, images: int, refiner_images: int) -> list[int]:
    """The scenes to look at: those after the training's, in which the model finds what it would find anywhere."""
    first = -(-images // VIEWS)
    return [training_seed(seed, first + index) for index in range(-(-refiner_images // VIEWS))]


def _write(job: _Job) -> None:
    look = job.refinement.open(job.weights, job.folder)
    stretched = job.refinement.stretched
    parts = [matched(look(image), truths, stretched) for image, truths in pictures_of(job.seed, VIEWS)]
    Samples.joined(parts).write(job.file)


def matched(looks: Looks, truths: Sequence[SeenObject], stretched: Callable[[Bytes], Bytes]) -> Samples:
    """Find the object that each close-up is of; those of none, and of one that shows little of itself, are left out."""
    whole = [np.where(truth.full_mask(), np.uint8(255), np.uint8(0)) for truth in truths]
    found: list[int] = []
    targets: list[Bytes] = []
    for n, (left, top, right, bottom) in enumerate(looks.windows.tolist()):
        cuts = [each[top:bottom, left:right] for each in whole]
        own = [k for k, cut in enumerate(cuts) if truths[k].name == CLASSES[looks.labels[n]] and cut.any()]
        masks = {k: stretched(cuts[k]) for k in own}
        overlaps = {k: _iou(mask > 127, looks.masks[n]) for k, mask in masks.items()}
        best = max(own, key=overlaps.__getitem__, default=None)
        if best is not None and overlaps[best] >= MIN_IOU and _shows_enough(truths[best]):
            found.append(n)
            targets.append(masks[best])
    side = looks.pixels.shape[1]
    return Samples(
        looks.pixels[found],
        looks.features[found],
        looks.labels[found],
        np.array(targets, np.uint8).reshape(len(found), side, side),
    )


def _shows_enough(truth: SeenObject) -> bool:
    return truth.image_share >= MIN_AREA and truth.visibility >= MIN_VISIBILITY


def _iou(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    shared, either = int(np.count_nonzero(one & other)), int(np.count_nonzero(one | other))
    return shared / max(1, either)
