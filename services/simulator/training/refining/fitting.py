"""The training of a refiner: cross entropy and Dice loss over its close-ups, resumable after every epoch."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.training.fitting import device_name
from services.simulator.training.progress import Progress
from services.simulator.training.refining.samples import Samples
from services.simulator.training.settings import TrainingSettings
from services.simulator.training.trainer import quick_arithmetic

if TYPE_CHECKING:
    import torch
    from torch import Tensor, nn

BATCH: Final = 64
RATE: Final = 3e-3
LAST_RATE: Final = 3e-5
WARM_UP: Final = 0.02
"""The share of all steps over which the learning rate rises at first."""


def fit_refiner(network: "nn.Module", samples: Samples, *, settings: TrainingSettings, progress: Progress) -> None:
    """Train `network` to its last epoch, going on from the checkpoint that is written after each epoch."""
    import torch  # noqa: PLC0415 - only the training needs it
    from ultralytics.utils.torch_utils import select_device  # noqa: PLC0415 - after load_ultralytics

    device: torch.device = select_device(device_name(settings), verbose=False)
    checkpoint, epochs = settings.work_dir / "refiner.pt", settings.refiner_epochs
    batches = max(1, len(samples.labels) // BATCH)
    with quick_arithmetic(settings, device.type):
        network.to(device).to(memory_format=torch.channels_last).train()
        optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-3, fused=True)
        for epoch in range(_resumed(checkpoint, network, optimizer), epochs):
            rng = np.random.default_rng([settings.seed, epoch])
            chosen = rng.permutation(len(samples.labels))[: batches * BATCH]
            for step, batch in enumerate(np.array_split(chosen, batches), start=epoch * batches):
                for group in optimizer.param_groups:
                    group["lr"] = rate(step, epochs * batches)
                optimizer.zero_grad(set_to_none=True)
                loss: Any = _loss(network, samples, batch, device)
                loss.backward()
                optimizer.step()
                progress("train refiner", step + 1, epochs * batches)
            _keep({"epoch": epoch, "network": network.state_dict(), "optimizer": optimizer.state_dict()}, checkpoint)


def rate(step: int, steps: int) -> float:
    """The learning rate of a step: half a cosine, after it has risen."""
    fallen = LAST_RATE + (RATE - LAST_RATE) * (1 + math.cos(math.pi * step / steps)) / 2
    return fallen * min(1.0, (step + 1) / (WARM_UP * steps))


def _keep(state: dict[str, Any], checkpoint: Path) -> None:
    import torch  # noqa: PLC0415 - see above

    partial = checkpoint.with_suffix(".part")
    torch.save(state, partial)
    partial.replace(checkpoint)


def _resumed(checkpoint: Path, network: "nn.Module", optimizer: "torch.optim.Optimizer") -> int:
    """Go on where an earlier run was interrupted; return the epoch to begin with."""
    import torch  # noqa: PLC0415 - see above

    if not checkpoint.exists():
        return 0
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    network.load_state_dict(state["network"])
    optimizer.load_state_dict(state["optimizer"])
    return int(state["epoch"]) + 1


def _loss(network: "nn.Module", samples: Samples, batch: NDArray[np.int64], device: "torch.device") -> "Tensor":
    import torch  # noqa: PLC0415 - see above
    from torch.nn.functional import binary_cross_entropy_with_logits  # noqa: PLC0415 - see above

    seen = (samples.pixels, samples.features, samples.labels)
    odds = network(*(torch.from_numpy(each[batch]).to(device) for each in seen)).float()
    truth = torch.from_numpy(samples.targets[batch]).to(device).float().div_(255)
    likely = odds.sigmoid()
    shared, both = (likely * truth).sum((1, 2)), (likely + truth).sum((1, 2))
    dice = 1 - (2 * shared + 1) / (both + 1)
    loss: Tensor = binary_cross_entropy_with_logits(odds, truth) + dice.mean()
    return loss
