"""What the training of a refiner asks of the detector that the refiner is for."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import nn


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """What a refiner sees of the objects that a model found in a picture.

    pixels: close-ups, objects x side x side x channels. features: what the model made of those places, objects x rows x
    columns x channels. labels: of the objects. windows: what each close-up shows of the picture (objects x 4): left,
    top, right and bottom in its pixels. masks: the coarse ones, objects x side x side.
    """

    pixels: NDArray[np.uint8]
    features: NDArray[np.float16]
    labels: NDArray[np.int64]
    windows: NDArray[np.int64]
    masks: NDArray[np.bool_]


Look = Callable[[NDArray[np.uint8]], Looks]
"""Looks at an RGB picture."""


@dataclass(frozen=True, slots=True)
class Refinement:
    """The detector's part.

    open: loads weights, in any process, to look with them; the folder is for files of its own. network: makes a network
    that knows nothing yet, for so many classes and channels of features; its forward takes pixels, features and labels
    to log odds of masks. stretched: a window of a picture as a close-up has it. kept: what weights have of a network.
    """

    open: Callable[[Path, Path], Look]
    network: Callable[[int, int], "nn.Module"]
    stretched: Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
    kept: Callable[["nn.Module"], dict[str, Any]]
