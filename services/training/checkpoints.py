"""Reads checkpoints of Ultralytics' trainer without executing anything in them.

A checkpoint is a pickle of whole networks. Objects that stand for the layers in it keep the layers' state and do
nothing; the tensors among it go into a network of our own making, of which Ultralytics gets a file of our own writing.
"""

import io
import re
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from services.simulator.world import CLASSES
from services.training.files import TrainingError

if TYPE_CHECKING:
    import torch
    from torch import nn


ARCHITECTURE: Final = "yolo11n-seg.yaml"

LAYER: Final = re.compile(
    r"(torch|ultralytics)\.nn\.modules\.\w+\.\w+|ultralytics\.(nn\.tasks\.SegmentationModel|utils\.IterableSimpleNamespace)"
)
"""The callables that Ultralytics' checkpoints name."""

_SCALAR: Final[Any] = np.float64(0).__reduce__()[0]
_NUMBERS: Final[Mapping[str, Any]] = {"numpy._core.multiarray.scalar": _SCALAR, "numpy.dtype": np.dtype}
_KNOWN: Final[tuple[Any, ...]] = (*((number, name) for name, number in _NUMBERS.items()), type(np.dtype(np.float64)))
_GOING_ON: Final = ("best_fitness", "stopper", "updates", "optimizer", "scaler")


class _Layer:
    """Stands for a layer or a part of it: holds its state, and does nothing."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The state after a whole epoch.

    epoch: from 0. weights: the averaged network's tensors by their names. going_on: what the optimizer and its
    surroundings go on from, plain numbers and tensors.
    """

    epoch: int
    weights: Mapping[str, "torch.Tensor"]
    going_on: Mapping[str, Any]

    @classmethod
    def read(cls, file: Path) -> "Checkpoint":
        """Read the trainer's checkpoint, or weights, whose epoch is -1.

        Raises:
            ValueError: it calls for what no network consists of, or holds no network; nothing in it was executed.
            Exception: torch cannot read it.
        """
        state = _state_in(file)
        network = (state.get("ema") or state.get("model")) if isinstance(state, dict) else None
        if not isinstance(network, _Layer):
            raise ValueError("it holds no network")  # noqa: TRY004 - what a file holds is no type of ours
        return cls(
            int(state["epoch"]),
            {name: each.float() if each.is_floating_point() else each for name, each in _tensors(network)},
            {name: state.get(name) for name in _GOING_ON},
        )

    def network(self) -> "nn.Module":
        """Return a network with these weights; call it after `load_ultralytics`."""
        from ultralytics.nn.tasks import SegmentationModel  # noqa: PLC0415 - only the training needs it

        network: nn.Module = SegmentationModel(ARCHITECTURE, nc=len(CLASSES), verbose=False)
        network.load_state_dict(self.weights)
        network.names = dict(enumerate(CLASSES))  # type: ignore[assignment]
        return network.eval()

    def averaged(self, other: "Checkpoint", share: float) -> "Checkpoint":
        """Return these weights averaged with `other`'s, of which `share` is taken; the rest as it is.

        Networks of which one was trained from the other do well in between (Wortsman et al., "Robust fine-tuning of
        zero-shot models", 2022).
        """
        weights = {
            name: each.lerp(other.weights[name], share) if each.is_floating_point() else each
            for name, each in self.weights.items()
        }
        return replace(self, weights=weights)

    def write(self, file: Path, arguments: Mapping[str, Any]) -> None:
        """Write a checkpoint that Ultralytics can resume from. arguments: of the training, by Ultralytics' names."""
        import torch  # noqa: PLC0415 - only the training needs it

        state = {"epoch": self.epoch, "model": None, "ema": self.network(), "train_args": dict(arguments)}
        torch.save(state | dict(self.going_on), file)


def extras_of(weights: Path) -> Mapping[str, Any]:
    """Return what weights hold beside the model, by name.

    Raises:
        Exception: see `Checkpoint.read`.
    """
    return {name: value for name, value in _state_in(weights).items() if name not in ("model", "ema")}


def _state_in(file: Path) -> Any:
    import torch  # noqa: PLC0415 - only the training needs it

    with _nothing_taken_as_safe():
        called_for = torch.serialization.get_unsafe_globals_in_checkpoint(file)
        layers = [name for name in called_for if LAYER.fullmatch(name)]
        if strangers := sorted({*called_for} - {*layers} - {*_NUMBERS}):
            raise ValueError(f"it calls for {strangers[0]}")
        torch.serialization.add_safe_globals([*_KNOWN, *((_Layer, name) for name in layers)])
        return torch.load(file, map_location="cpu", weights_only=True)


@contextmanager
def _nothing_taken_as_safe() -> Iterator[None]:
    """Clear torch's list of safe classes while the context lasts: Ultralytics adds real layers to it."""
    import torch  # noqa: PLC0415 - only the training needs it

    before = torch.serialization.get_safe_globals()
    torch.serialization.clear_safe_globals()
    try:
        yield
    finally:
        torch.serialization.clear_safe_globals()
        torch.serialization.add_safe_globals(before)


def _tensors(layer: Any, prefix: str = "") -> Iterator[tuple[str, "torch.Tensor"]]:
    for name, tensor in {**layer._parameters, **layer._buffers}.items():  # noqa: SLF001 - torch's own names
        if tensor is not None and name not in layer._non_persistent_buffers_set:  # noqa: SLF001
            yield f"{prefix}{name}", tensor
    for name, inner in layer._modules.items():  # noqa: SLF001
        yield from _tensors(inner, f"{prefix}{name}.")


_ABSOLUTE_PATH: Final = re.compile(rb"(?<![\w:/.-])(?:/[\w.+-]+){2,}|[A-Za-z]:\\[\w.+-]+")


def write_weights(checkpoint: Path, output: Path, imgsz: int, more: Mapping[str, Any] | None = None) -> None:
    """Strip `checkpoint`, which this command wrote, and put its averaged model at `output`, with `more` beside it.

    Raises TrainingError when a path of this machine would get into the file.
    """
    import torch  # noqa: PLC0415 - only the training needs it

    arguments = {"task": "segment", "model": ARCHITECTURE, "imgsz": imgsz}
    model: Any = Checkpoint.read(checkpoint).network().half()
    model.requires_grad_(requires_grad=False)
    model.args, model.criterion, model.pt_path = dict(arguments), None, None
    model.yaml["yaml_file"] = ARCHITECTURE
    buffer = io.BytesIO()
    kept = {"epoch": -1, "model": model, "ema": None, "optimizer": None, "train_args": arguments, **(more or {})}
    torch.save(kept, buffer)
    content = buffer.getvalue()
    if found := embedded_paths(content):
        raise TrainingError(f"the weights would name paths of this machine: {', '.join(found)}")
    output.parent.mkdir(parents=True, exist_ok=True)
    partial = output.with_suffix(".part")
    partial.write_bytes(content)
    partial.replace(output)


def embedded_paths(content: bytes) -> list[str]:
    """The absolute paths in a torch file, but for the tensors' own bytes."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [archive.read(name) for name in archive.namelist() if "/data/" not in name]
    return sorted({match.decode() for member in members for match in _ABSOLUTE_PATH.findall(member)})
