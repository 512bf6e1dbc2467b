"""Trains the refiner of given weights."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from services.simulator.world import CLASSES
from services.training.fitting import device_name
from services.training.parallel import Progress
from services.training.refining.fitting import BATCH, fit_refiner
from services.training.refining.refinement import Refinement
from services.training.refining.samples import Samples, refining_seeds, write_samples
from services.training.settings import TrainingSettings


@dataclass(frozen=True, slots=True)
class TrainedRefiner:
    """A trained refiner in checkpoint form, and the number of objects it learned from; empty and 0 without one."""

    kept: Mapping[str, Any]
    objects: int


NO_REFINER: Final = TrainedRefiner({}, 0)


def refine(settings: TrainingSettings, weights: Path, refinement: Refinement, progress: Progress) -> TrainedRefiner:
    """Train the refiner of `weights`, unless they find too few objects to learn from.

    It begins with the refiner of the weights that the run began with, if they have one, except where it is all that is
    trained.
    """
    import torch  # noqa: PLC0415 - only the training needs it

    seeds = refining_seeds(settings.seed, settings.images, settings.refiner_images)
    folder = settings.work_dir / "close-ups"
    device = device_name(settings)
    files = write_samples(
        folder, refinement, weights, seeds, device=device, workers=settings.workers, progress=progress
    )
    samples = Samples(files)
    if len(samples.labels) < BATCH:
        return NO_REFINER
    torch.manual_seed(settings.seed)
    start = None if settings.only_refiner else settings.start
    state = None if start is None else refinement.state_in(start)
    network = refinement.network(len(CLASSES), samples.take(np.zeros(1, np.int64))["features"].shape[-1])
    if state is not None:
        network.load_state_dict(state)
    fit_refiner(network, samples, settings=settings, progress=progress)
    return TrainedRefiner(refinement.kept(network), len(samples.labels))
