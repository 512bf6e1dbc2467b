"""Exports the refiner's network for libraries other than torch."""

import io
import warnings
from typing import Any, Final

import torch

from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.refiner import blank_close_ups

OPSET: Final = 17
NAMES: Final = ("pixels", "features", "labels", "scores", "odds", "qualities")
"""What it takes, as `CloseUps` has it, and what it returns; the first dimension of each is any number of objects."""


def onnx_of(network: RefinerNetwork) -> bytes:
    """Return a network as the content of an ONNX file, ready to run. The network can no longer be trained."""
    network.eval().fuse()
    seen = blank_close_ups(2, network.prototypes)
    example = tuple(map(torch.from_numpy, (seen.pixels, seen.features, seen.labels, seen.scores)))
    file: Any = io.BytesIO()  # its types know of paths alone
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch would rather have another exporter used, which needs more packages
        torch.onnx.export(
            network,
            example,
            file,
            input_names=NAMES[: len(example)],
            output_names=NAMES[len(example) :],
            dynamic_axes={name: {0: "objects"} for name in NAMES},
            opset_version=OPSET,
            dynamo=False,
        )
    content: bytes = file.getvalue()
    return content
