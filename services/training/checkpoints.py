"""Reads checkpoints of Ultralytics' trainer without executing anything in them.

A checkpoint is a pickle of whole networks. Objects that stand for the layers in it keep the layers' state and do
nothing; the tensors among it go into a network of our own making, of which Ultralytics gets a file of our own writing.
"""

import io
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from services.training.files import TrainingError

if TYPE_CHECKING:
    import torch
    from torch import nn


ARCHITECTURE: Final = "yolo11n-seg.yaml"
"""Of a model that is trained from scratch."""

NETWORKS: Final = {"Segment": "SegmentationModel", "Detect": "DetectionModel"}
"""Ultralytics' networks by their last layer: of models whose loss `partial_labels` knows."""

LAYER: Final = re.compile(
    r"torch\.nn\.modules\.\w+\.\w+|ultralytics\.nn\.modules(\.\w+)?\.\w+"
    r"|ultralytics\.(nn\.tasks\.(Segmentation|Detection)Model|(yolo\.)?utils\.IterableSimpleNamespace)"
    r"|ultralytics\.utils\.(loss|tal)\.\w+"
)
"""The classes that Ultralytics' checkpoints name, published ones and those of older releases among them."""

_SCALAR: Final[Any] = np.float64(0).__reduce__()[0]
_PATHS: Final = [
    f"{module}.{name}" for module in ("pathlib", "pathlib._local") for name in ("PosixPath", "WindowsPath")
]


def _nothing(*_: object) -> None:
    """Stand for a call whose result nobody needs: getattr of a layer's method, a path."""


_CALLED: Final[Mapping[str, Any]] = {
    "numpy._core.multiarray.scalar": _SCALAR,
    "numpy.core.multiarray.scalar": _SCALAR,
    "numpy.dtype": np.dtype,
    **dict.fromkeys(["builtins.getattr", *_PATHS], _nothing),
}
_KNOWN: Final[tuple[Any, ...]] = (*((called, name) for name, called in _CALLED.items()), type(np.dtype(np.float64)))
_GOING_ON: Final = ("best_fitness", "stopper", "updates", "optimizer", "scaler")


ACTIVATION: Final = re.compile(r"(torch\.)?nn\.\w+\([\w., =-]*\)")
"""A layer of torch's, and no other call."""

CLASS_BRANCHES: Final = ("cv3", "one2one_cv3")
CLASS_ROWS: Final = re.compile(r"model\.\d+\.(one2one_)?cv3\.\d+\.2\.(weight|bias)")
"""The last layer's tensors that have a row for each class."""


class _Layer:
    """Stands for a layer or a part of it: holds its state, and does nothing."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The state after a whole epoch.

    epoch: from 0. weights: the averaged network's tensors by their names. classes: names by index. architecture: as
    Ultralytics' YAML has it. going_on: what the optimizer and its surroundings go on from, plain numbers and tensors.
    """

    epoch: int
    weights: Mapping[str, "torch.Tensor"]
    classes: Sequence[str]
    architecture: Mapping[str, Any]
    going_on: Mapping[str, Any]

    @classmethod
    def read(cls, file: Path) -> "Checkpoint":
        """Read the trainer's checkpoint, or weights, whose epoch is -1.

        Raises:
            ValueError: it calls for what no network consists of, or holds no network, or one that cannot be trained
                here; nothing in it was executed.
            Exception: torch cannot read it.
        """
        state = _state_in(file)
        network = (state.get("ema") or state.get("model")) if isinstance(state, dict) else None
        if not isinstance(network, _Layer):
            raise ValueError("it holds no network")  # noqa: TRY004 - what a file holds is no type of ours
        return cls(
            int(state.get("epoch", -1)),
            {name: each.float() if each.is_floating_point() else each for name, each in _tensors(network)},
            _classes(network),
            _architecture(network),
            {name: state.get(name) for name in _GOING_ON},
        )

    @property
    def task(self) -> str:
        """The model's task, in Ultralytics' words."""
        return "segment" if _head(self.architecture) == "Segment" else "detect"

    @property
    def architecture_name(self) -> str:
        return Path(str(self.architecture.get("yaml_file", ARCHITECTURE))).name

    def network(self) -> "nn.Module":
        """Return a network with these weights; call it after `load_ultralytics`."""
        network = self._new_network()
        network.load_state_dict(self.weights)
        return network.eval()

    def with_classes(self, classes: Sequence[str], new_names: Mapping[str, str]) -> "Checkpoint":
        """Return these weights for other classes; call it after `load_ultralytics`.

        new_names: of this one's classes, where they have others there; no two the same. A class that this one does not
        have begins with random numbers.

        Raises:
            ValueError: its architecture is none, or another than that of the weights.
        """
        named = {new_names.get(name, name): row for row, name in enumerate(self.classes)}
        rows = [(new, named[name]) for new, name in enumerate(classes) if name in named]
        other = replace(self, classes=tuple(classes))
        weights = other._new_network().state_dict()  # noqa: SLF001 - of the same class
        if weights.keys() != self.weights.keys():
            raise ValueError("its layers are others than it says; train it with Ultralytics")
        for name, tensor in weights.items():
            if CLASS_ROWS.fullmatch(name):
                for new, row in rows:
                    tensor[new] = self.weights[name][row]
            else:
                weights[name] = self.weights[name]
        return replace(other, weights=weights)

    def _new_network(self) -> "nn.Module":
        """Return a network with random numbers whose layers are as large as these weights'."""
        from torch import nn  # noqa: PLC0415 - only the training needs it

        classes = len(self.classes)
        network = self._made_for(classes)
        head, width = network.model[-1], self._class_width()
        if width != head.cv3[0][-1].in_channels:
            # Ultralytics makes these layers as wide as there are classes, and keeps their width in fine-tuning.
            wider = self._made_for(width).model[-1]
            for name in filter(partial(hasattr, wider), CLASS_BRANCHES):
                for level in getattr(wider, name):
                    level[-1] = nn.Conv2d(width, classes, 1)
                setattr(head, name, getattr(wider, name))
            head.bias_init()
        network.names = dict(enumerate(self.classes))
        made: nn.Module = network
        return made

    def _made_for(self, classes: int) -> Any:
        from ultralytics.nn import tasks  # noqa: PLC0415 - only the training needs it

        _check_layers(self.architecture)
        made = getattr(tasks, NETWORKS[_head(self.architecture)])
        return made(deepcopy(dict(self.architecture)), nc=classes, verbose=False)

    def _class_width(self) -> int:
        """Return how wide the last layer's branch for the classes is."""
        widths = [each.shape[1] for name, each in self.weights.items() if CLASS_ROWS.fullmatch(name) and each.ndim > 1]
        if not widths:
            raise ValueError("its last layer has no rows for classes")
        return widths[0]

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
        if strangers := sorted({*called_for} - {*layers} - {*_CALLED}):
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


def _classes(network: Any) -> tuple[str, ...]:
    """Return the names of a network's classes.

    Raises:
        ValueError: it does not name them by number.
    """
    try:
        return tuple(str(network.names[number]) for number in range(len(network.names)))
    except (AttributeError, LookupError, TypeError) as error:
        raise ValueError("its classes have no names by number") from error


def _architecture(network: Any) -> Mapping[str, Any]:
    """Return the architecture of a network, as it was when the network was made.

    Raises:
        ValueError: there is none, or none of a model that can be trained here.
    """
    found: Any = getattr(network, "yaml", None)
    head = _head(found)
    if head not in NETWORKS:
        known = " or ".join(NETWORKS)
        raise ValueError(f"its last layer is {head[:40]}, where {known} can be trained here; train it with Ultralytics")
    if ACTIVATION.fullmatch(str(found.get("activation"))):
        return {**found}
    return {name: value for name, value in found.items() if name != "activation"}  # Ultralytics would execute it


def _head(architecture: Any) -> str:
    """Return the kind of the last layer."""
    try:
        return str(architecture["head"][-1][2])
    except (LookupError, TypeError) as error:
        raise ValueError("it does not say of which layers it is made") from error


def _check_layers(architecture: Mapping[str, Any]) -> None:
    """Raise ValueError for an architecture of anything but layers: Ultralytics would call whatever it names."""
    from torch import nn  # noqa: PLC0415 - only the training needs it
    from ultralytics.nn import modules  # noqa: PLC0415 - after load_ultralytics

    try:
        names = [str(row[2]) for row in (*architecture["backbone"], *architecture["head"])]
    except (LookupError, TypeError) as error:
        raise ValueError("it does not say of which layers it is made") from error
    for name in names:
        found = getattr(nn, name[3:], None) if name.startswith("nn.") else getattr(modules, name, None)
        if not (isinstance(found, type) and issubclass(found, nn.Module)) or found is modules.TorchVision:  # downloads
            raise ValueError(f"it has {name[:40]} among its layers, which is none to train")


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

    trained = Checkpoint.read(checkpoint)
    arguments = {"task": trained.task, "model": trained.architecture_name, "imgsz": imgsz}
    model: Any = trained.network().half()
    model.requires_grad_(requires_grad=False)
    model.args, model.criterion, model.pt_path = dict(arguments), None, None
    model.yaml["yaml_file"] = trained.architecture_name
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
