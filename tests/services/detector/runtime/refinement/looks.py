"""Networks and close-ups that mean nothing."""

import numpy as np
import torch

from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.refiner import CHANNELS, FEATURES_SIDE, SIDE, CloseUps

CLASSES, PROTOTYPES = 3, 4


def network() -> RefinerNetwork:
    """Make one that adds something of its own."""
    torch.manual_seed(1)
    made = RefinerNetwork(CLASSES, PROTOTYPES)
    torch.nn.init.normal_(made.out.weight)
    return made


def looks(count: int) -> CloseUps:
    rng = np.random.default_rng(count)
    return CloseUps(
        rng.integers(0, 256, (count, SIDE, SIDE, CHANNELS), np.uint8),
        rng.random((count, FEATURES_SIDE, FEATURES_SIDE, PROTOTYPES)).astype(np.float32),
        rng.integers(0, CLASSES, count),
        rng.random(count).astype(np.float32),
        np.zeros((count, 4), np.int64),
    )
