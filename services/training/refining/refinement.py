"""The interface of the detector to the training of its refiner."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import nn


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """The refiner's inputs for the objects that a model found in an image.

    pixels: close-ups, objects x side x side x channels. features: what the model made of those places, objects x rows x
    columns x channels. labels, scores: of the objects. windows: what each close-up shows of the model's input, objects
    x 4: left, top, right and bottom in its pixels. masks: the coarse ones, objects x side x side. letterboxed: puts a
    mask of the picture into the model's input, nothing around it.
    """

    pixels: NDArray[np.uint8]
    features: NDArray[np.float16]
    labels: NDArray[np.int64]
    scores: NDArray[np.float32]
    windows: NDArray[np.int64]
    masks: NDArray[np.bool_]
    letterboxed: Callable[[NDArray[np.uint8]], NDArray[np.uint8]]


RefinerLook = Callable[[NDArray[np.uint8]], Looks]
"""Looks at an RGB picture."""


@dataclass(frozen=True, slots=True)
class Refinement:
    """Provides the detector's close-ups and network.

    open: loads weights, in any process, onto a device to look with them; the folder is for files of its own. network:
    makes a network that knows nothing yet, for so many classes and channels of features; its forward takes pixels,
    features, labels and scores to log odds of masks and of their qualities. stretched: a window of the model's input as
    a close-up has it. kept: what weights have of a network. state_in: the state of the network in weights, None
    without one.
    """

    open: Callable[[Path, str, Path], RefinerLook]
    network: Callable[[int, int], "nn.Module"]
    stretched: Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
    kept: Callable[["nn.Module"], dict[str, Any]]
    state_in: Callable[[Path], Mapping[str, Any] | None]
