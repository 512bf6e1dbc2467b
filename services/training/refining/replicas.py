"""Trains a network on two processors at once.

Each has a copy of it, and half of each batch: processors that share layers this small wait for each other for a quarter
of the time, and for far more if something else keeps one of them busy. There are two halves wherever it learns, so what
it learns does not depend on that.
"""

import ctypes
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray

from services.training.refining.samples import SEEN, Records, Samples
from services.training.trainer import quick_arithmetic

if TYPE_CHECKING:
    import torch
    from torch import Tensor, nn

PARTS: Final = 2

QUALITY: Final = 0.3
"""The weight of the loss of qualities relative to that of masks."""

HALF: Final = 0.5

MALLOPT: Final = {-1: 2**31 - 1, -2: 2**28, -3: 2**30}
"""glibc's thresholds for keeping, requesting and mapping memory, in bytes; see mallopt(3)."""


class Replicas:
    """A network and its copies; normalisation layers, once frozen, are the network's own."""

    def __init__(self, network: "nn.Module", samples: Samples, device: "torch.device", threads: int) -> None:
        self._networks = [network, *(deepcopy(network) for _ in range(PARTS - 1))]
        self._samples = samples
        self._device = device
        self._threads = ThreadPoolExecutor(threads, thread_name_prefix="replica")
        _keep_freed_memory()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown()

    def learn(self, batch: NDArray[np.int64]) -> None:
        """Store the gradients of a batch of samples, whose number is even, in the network's parameters."""
        import torch  # noqa: PLC0415 - only the training needs it

        network, *copies = self._networks
        with torch.no_grad():
            for copy in copies:
                for theirs, ours in zip(copy.parameters(), network.parameters(), strict=True):
                    theirs.copy_(ours)
        list(self._threads.map(self._learn, self._networks, np.split(batch, PARTS)))
        for gradient, *others in zip(*(_gradients(each) for each in self._networks), strict=True):
            for other in others:
                gradient.add_(other)
            gradient.div_(PARTS)

    def _learn(self, network: "nn.Module", part: NDArray[np.int64]) -> None:
        network.zero_grad(set_to_none=True)
        with quick_arithmetic(1, self._device.type):
            loss = _loss(network, self._samples.take(part), self._device)
            loss.backward()  # type: ignore[no-untyped-call]


def _keep_freed_memory() -> None:
    """Keep freed memory for the next step: otherwise threads wait while the kernel clears it anew."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # other C libraries have none
    if mallopt is not None:
        for option, value in MALLOPT.items():
            mallopt(option, value)


def _gradients(network: "nn.Module") -> "list[Tensor]":
    return [each.grad for each in network.parameters() if each.grad is not None]


def _loss(network: "nn.Module", batch: Records, device: "torch.device") -> "Tensor":
    """Return the loss of objects' masks (cross entropy and Dice) and that of all qualities."""
    import torch  # noqa: PLC0415 - only the training needs it
    from torch.nn.functional import binary_cross_entropy_with_logits  # noqa: PLC0415 - only the training needs it

    def given(name: str) -> "Tensor":
        return torch.from_numpy(batch[name].copy()).to(device)

    odds, quality = network(*map(given, SEEN))
    odds, truth = odds.float(), given("targets").float().div_(255)
    there = truth.amax((1, 2)) > 0
    entropy = binary_cross_entropy_with_logits(odds, truth, reduction="none").mean((1, 2))
    likely = odds.sigmoid()
    dice = 1 - (2 * (likely * truth).sum((1, 2)) + 1) / ((likely + truth).sum((1, 2)) + 1)
    masks = ((entropy + dice) * there).sum() / there.sum().clamp_min(1)
    qualities = binary_cross_entropy_with_logits(quality.float(), _iou(odds > 0, truth > HALF))
    loss: Tensor = masks + QUALITY * qualities
    return loss


def _iou(masks: "Tensor", others: "Tensor") -> "Tensor":
    """IoU of masks with others; 0 where both are empty."""
    return (masks & others).sum((1, 2)) / (masks | others).sum((1, 2)).clamp_min(1)
