"""Runs a trained refiner under torch, and stores it in the checkpoint of the model it refines."""

from collections.abc import Mapping
from typing import Any, Final

import torch
from numpy.typing import NDArray

from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.refiner import CloseUps, Floats, Refined, refined

KEY: Final = "mask_refiner"
"""Of the network's tensors in a checkpoint; Ultralytics reads only the keys that it knows."""


class TorchRefiner:
    """The network on a device."""

    def __init__(self, network: RefinerNetwork, device: torch.device) -> None:
        self._network = network.eval().to(device).to(memory_format=torch.channels_last)
        self._network.fuse()
        self._device = device

    def run(self, seen: CloseUps) -> Refined:
        """See `Refiner.run`."""
        return refined(seen, self._compute)

    def _compute(self, given: list[NDArray[Any]]) -> tuple[Floats, Floats]:
        with torch.inference_mode():
            odds, qualities = self._network(*(torch.from_numpy(each).to(self._device) for each in given))
            return odds.float().cpu().numpy(), qualities.float().cpu().numpy()


def network_in(checkpoint: Mapping[str, Any], classes: int, prototypes: int) -> RefinerNetwork | None:
    """Return the network from a checkpoint of a model with this many classes and prototypes, if there is one.

    Raises:
        ValueError: what is kept is of another shape.
    """
    state = checkpoint.get(KEY)
    if state is None:
        return None
    network = RefinerNetwork(classes, prototypes)
    try:
        network.load_state_dict(state)
    except (RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(f"its {KEY} is none for {classes} classes and {prototypes} prototypes of masks") from error
    return network


def kept(network: torch.nn.Module) -> dict[str, Any]:
    """Return the entry that stores the network in a checkpoint for `network_in`, in half precision."""
    return {
        KEY: {
            name: value.half() if value.is_floating_point() else value for name, value in network.state_dict().items()
        }
    }
