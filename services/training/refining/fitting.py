"""The training of a refiner, resumable after every epoch."""

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from services.training.files import TrainingError, first_line, keep_file
from services.training.fitting import device_name
from services.training.parallel import Progress
from services.training.refining.replicas import PARTS, Replicas
from services.training.refining.samples import Samples
from services.training.settings import TrainingSettings

if TYPE_CHECKING:
    import torch
    from torch import nn

CHECKPOINT: Final = "refiner.pt"
BATCH: Final = 64
RATE: Final = 3e-3
LAST_RATE: Final = 3e-5
WARM_UP: Final = 0.02
"""The share of all steps over which the learning rate rises at first."""


def fit_refiner(network: "nn.Module", samples: Samples, *, settings: TrainingSettings, progress: Progress) -> None:
    """Train `network` to its last epoch, resuming from the checkpoint that is written after each epoch."""
    import torch  # noqa: PLC0415 - only the training needs it
    from ultralytics.utils.torch_utils import select_device  # noqa: PLC0415 - after load_ultralytics

    device: torch.device = select_device(device_name(settings), verbose=False)
    checkpoint, epochs = settings.work_dir / CHECKPOINT, settings.refiner_epochs
    batches = max(1, len(samples.labels) // BATCH)
    network.to(device).to(memory_format=torch.channels_last).train()
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-3, fused=True)
    begin = _resumed(checkpoint, network, optimizer)
    with Replicas(network, samples, device, min(settings.workers, PARTS)) as replicas:
        for epoch in range(begin, epochs):
            chosen = drawn(samples.labels, batches * BATCH, np.random.default_rng([settings.seed, epoch]))
            for step, batch in enumerate(np.split(chosen, batches), start=epoch * batches):
                for group in optimizer.param_groups:
                    group["lr"] = rate(step, epochs * batches)
                replicas.learn(batch)
                optimizer.step()
                progress("train refiner", step + 1, epochs * batches)
            _keep({"epoch": epoch, "network": network.state_dict(), "optimizer": optimizer.state_dict()}, checkpoint)


def drawn(labels: NDArray[np.int64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw samples with replacement: a class with four times as many is drawn only twice as often."""
    of_class = np.bincount(labels)
    likely = 1 / np.sqrt(of_class[labels])
    return rng.choice(len(labels), count, p=likely / likely.sum())


def rate(step: int, steps: int) -> float:
    """The learning rate of a step: a warm-up, then half a cosine."""
    fallen = LAST_RATE + (RATE - LAST_RATE) * (1 + math.cos(math.pi * step / steps)) / 2
    return fallen * min(1.0, (step + 1) / (WARM_UP * steps))


def _keep(state: dict[str, Any], checkpoint: Path) -> None:
    import torch  # noqa: PLC0415 - only the training needs it

    content = io.BytesIO()
    torch.save(state, content)
    keep_file(checkpoint, content.getvalue())


def kept_state(checkpoint: Path) -> dict[str, Any] | None:
    """Return the state kept by `fit_refiner`, if there is one. Nothing in the file is executed.

    Raises:
        TrainingError: it is something else.
    """
    import torch  # noqa: PLC0415 - only the training needs it

    if not checkpoint.exists():
        return None
    try:
        state = torch.load(checkpoint, map_location="cpu", weights_only=True)
        return {"epoch": int(state["epoch"]), "network": state["network"], "optimizer": state["optimizer"]}
    except Exception as error:
        raise _no_checkpoint(checkpoint, "nothing that can be read") from error


def _resumed(checkpoint: Path, network: "nn.Module", optimizer: "torch.optim.Optimizer") -> int:
    """Resume an interrupted run; return the epoch to begin with."""
    state = kept_state(checkpoint)
    if state is None:
        return 0
    try:
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
    except Exception as error:
        raise _no_checkpoint(checkpoint, first_line(error)) from error
    return int(state["epoch"]) + 1


def _no_checkpoint(checkpoint: Path, reason: str) -> TrainingError:
    return TrainingError(f"{checkpoint}: not a checkpoint of a refiner ({reason}); remove it")
