"""A trained refiner at work, and how it is kept in a checkpoint beside the model whose masks it refines."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray

from services.detector.runtime.refinement.closeups import CloseUps
from services.detector.runtime.refinement.network import RefinerNetwork

KEY: Final = "mask_refiner"
"""Of the network's tensors in a checkpoint; Ultralytics reads only the keys that it knows."""

AT_ONCE: Final = 32
"""Close-ups that are computed together: more need more memory, and are no quicker each."""


class TorchRefiner:
    """The network on a device."""

    def __init__(self, network: RefinerNetwork, device: torch.device) -> None:
        self._network = network.eval().to(device).to(memory_format=torch.channels_last)
        self._network.fuse()
        self._device = device

    def run(self, seen: CloseUps) -> NDArray[np.float32]:
        """See `Refiner.run`."""
        given = [torch.from_numpy(each) for each in (seen.pixels, seen.features, seen.labels)]
        found = np.empty(seen.pixels.shape[:3], np.float32)
        with torch.inference_mode():
            for begin in range(0, len(found), AT_ONCE):
                part = slice(begin, begin + AT_ONCE)
                odds = self._network(*(each[part].to(self._device) for each in given))
                found[part] = odds.float().cpu().numpy()
        return found


def network_in(checkpoint: Mapping[str, Any], classes: int) -> RefinerNetwork | None:
    """Return the network that is kept in a checkpoint of a model of so many classes; None if there is none.

    Raises:
        ValueError: what is kept is of another shape.
    """
    state = checkpoint.get(KEY)
    if state is None:
        return None
    try:
        network = RefinerNetwork(classes, len(state["of_features.0.weight"]))
        network.load_state_dict(state)
    except (KeyError, RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(f"its {KEY} is none for {classes} classes") from error
    return network


def kept(network: torch.nn.Module) -> dict[str, Any]:
    """Return what to add to a checkpoint so that `network_in` finds the network there, in half precision."""
    return {
        KEY: {
            name: value.half() if value.is_floating_point() else value for name, value in network.state_dict().items()
        }
    }
