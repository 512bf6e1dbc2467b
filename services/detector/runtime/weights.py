"""Reads the weights of a model: its task, classes and module."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch
from ultralytics.models import YOLO
from ultralytics.nn import tasks
from ultralytics.utils.torch_utils import select_device

from services.detector.model import ModelError, first_line
from services.detector.runtime.checkpoint import DOWNLOADS, CheckpointError, read_checkpoint
from services.detector.runtime.model_file import (
    COLOURS,
    EXPORTS,
    SEGMENT,
    TASKS,
    ModelFile,
    NamesError,
    class_names,
)
from services.detector.runtime.nms_branches import HeadError, head_of
from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.torch_refiner import network_in
from services.detector.settings import WEIGHTS_SUFFIX, is_weights

NEEDED: Final = "torch 2.6 and Ultralytics 8.4.175"
"""What the extra [detector] asks for; Ultralytics before 8.4.68 does not read weights as data alone."""
DEFAULT_SIDE: Final = 640
"""What Ultralytics trains at unless told otherwise."""
NAMES_CURE: Final = "give its model one name for each class, numbered from 0, and save it again"


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights(ModelFile):
    """A loaded checkpoint. refiner: of its masks, if the file has one and it is wanted."""

    model: Any
    refiner: RefinerNetwork | None


def load_weights(
    model: str, option: str = "--model", *, refine: bool = True, nms: bool | None = None, download: bool = False
) -> Weights:
    """Read exactly the named checkpoint; nothing in it is executed.

    refine: with its refiner. nms: whether overlapping boxes are suppressed, or the model's NMS-free head is used; None
    for Ultralytics' own default. download: let Ultralytics fetch what is not here.

    Raises:
        ModelError: the file is no checkpoint, or of a task that finds no objects, or would be executed.
    """
    what = f"{option} {model}"
    if not getattr(getattr(tasks, "_SafeLoad", None), "SUPPORTED", False):
        raise ModelError(f"{what}: what is in it would be executed: {NEEDED} or later are needed")
    if not is_weights(model):
        raise ModelError(f"{what}: neither Ultralytics weights, which end in {WEIGHTS_SUFFIX}, nor {EXPORTS}")
    try:
        path = Path(model)
        if download and not path.is_file():
            with DOWNLOADS:
                fetched: Any = YOLO(model)
            path = Path(fetched.ckpt_path)
        module, content = read_checkpoint(path)
        _check(module, what)
        head = head_of(module, nms=nms)
        names = module.names = _names(module)
        masks = getattr(module.model[-1], "nm", None)  # what Ultralytics calls the number of its prototypes
        return Weights(
            path=path,
            digest=hashlib.sha256(path.read_bytes()).hexdigest(),
            model=module,
            names=names,
            segments=module.task == SEGMENT,
            longest=_longest(content),
            stride=max(32, int(module.stride.max())),
            refiner=network_in(content, len(names), masks) if refine and masks is not None else None,
            head=head,
            agnostic=isinstance(module, tasks.YOLOEModel),
        )
    except ModelError:
        raise
    except HeadError as error:
        raise ModelError(f"{'--nms' if nms else '--no-nms'} with {what}: {error}") from error
    except Exception as error:
        why = str(error) if isinstance(error, CheckpointError) else first_line(error)
        raise ModelError(f"{what}: not a model that can be used: {why}") from error


def _check(module: Any, what: str) -> None:
    """Raise ModelError or CheckpointError for a model of another task, or for images unlike a camera's."""
    if module.task not in TASKS:
        raise ModelError(f"{what}: a model for {module.task!r}, not for one of {', '.join(TASKS)}")
    channels = getattr(module, "yaml", {}).get("channels", COLOURS)
    if channels != COLOURS:
        raise CheckpointError(f"it is for images of {channels} channels, and cameras have {COLOURS}: train it on RGB")


def _names(module: Any) -> dict[int, str]:
    """Return the names of a model's classes, by label.

    Raises:
        CheckpointError: they are not one for each class.
    """
    classes = module.model[-1].nc
    given = getattr(module, "names", None)
    if given is None or (isinstance(given, Mapping | list | tuple) and not given):
        given = [f"class{label}" for label in range(classes)]
    try:
        return class_names(given, classes)
    except NamesError as error:
        raise CheckpointError(f"{error}: {NAMES_CURE}") from error


def _longest(content: Mapping[str, Any]) -> int:
    """Return the longer side of the input that the model was trained at."""
    side = content.get("train_args", {}).get("imgsz", DEFAULT_SIDE)
    return int(max(side) if isinstance(side, list | tuple) else side)


def device_of(name: str | None) -> torch.device:
    """Return the device of a name that Ultralytics knows, or the best available.

    Raises:
        ModelError: it is not there.
    """
    try:
        found = select_device(name or ("" if torch.cuda.is_available() else "cpu"), verbose=False)
    except Exception as error:
        raise ModelError(f"--device {name}: {first_line(error)}") from error
    if not isinstance(found, torch.device) or (name and found.type != _kind_of(name)):  # the processor instead, untold
        raise ModelError(f"--device {name}: torch has no such device here")
    return found


def _kind_of(name: str) -> str:
    """Return the type of the requested device; plain numbers are GPUs."""
    kind = name.strip().partition(":")[0].lower()
    return kind if kind.isalpha() else "cuda"
