"""The interface of an inference engine, independent of its library."""

from dataclasses import dataclass
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from services.detector.runtime.postprocess import Output
from services.detector.runtime.refinement.refiner import Refiner

Runtime = Literal["torch", "onnx", "openvino", "openvino-int8", "tensorrt"]

BATCH_ON_GPU: Final = 8
"""Images of different cameras that one call computes together at most, where many cost little more than one."""


class OutOfMemoryError(Exception):
    """The device has not enough memory for the batch."""


class Engine(Protocol):
    """A model that is ready to compute. Used from one thread at a time."""

    def run(self, images: NDArray[np.uint8]) -> list[Output]:
        """Compute a batch, images x height x width x RGB, both sides multiples of the model's stride.

        Raises:
            OutOfMemoryError: a smaller batch may do.
        """


def outputs(predictions: NDArray[np.float32], prototypes: NDArray[np.float32] | None) -> list[Output]:
    """Split a batch's arrays into those of each image."""
    return [Output(each, None if prototypes is None else prototypes[n]) for n, each in enumerate(predictions)]


@dataclass(frozen=True, slots=True)
class RunningModel:
    """A model under a runtime. reference: what its results are checked against once. refiner: of its masks.

    many: whether it computes many images in little more time than one.
    """

    runtime: Runtime
    engine: Engine
    reference: Engine | None
    refiner: Refiner | None
    many: bool = False
