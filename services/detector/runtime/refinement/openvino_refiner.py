"""A trained refiner under OpenVINO: quicker than under torch, whose threads get in the way of OpenVINO's."""

import numpy as np
import torch
from numpy.typing import NDArray

from services.detector.runtime.openvino_engine import converted, request_of
from services.detector.runtime.refinement.closeups import CHANNELS, FEATURES_SIDE, SIDE, CloseUps
from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.torch_refiner import AT_ONCE


class OpenVinoRefiner:
    """The network on the processor."""

    def __init__(self, network: RefinerNetwork, threads: int) -> None:
        example = (
            torch.zeros(2, SIDE, SIDE, CHANNELS, dtype=torch.uint8),
            torch.zeros(2, FEATURES_SIDE, FEATURES_SIDE, network.prototypes, dtype=torch.float16),
            torch.zeros(2, dtype=torch.int64),
        )
        self._request = request_of(converted(network.eval(), example), threads)

    def run(self, seen: CloseUps) -> NDArray[np.float32]:
        """See `Refiner.run`."""
        found = np.empty(seen.pixels.shape[:3], np.float32)
        for begin in range(0, len(found), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            found[part] = self._request.infer([seen.pixels[part], seen.features[part], seen.labels[part]])[0]
        return found
