"""An Ultralytics checkpoint: what it is a model of, and its module."""

import hashlib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch
from ultralytics.models import YOLO
from ultralytics.nn import tasks
from ultralytics.utils.torch_utils import select_device

from services.detector.model import ModelError, first_line
from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.torch_refiner import network_in

SEGMENT: Final = "segment"
TASKS: Final = (SEGMENT, "detect")
SUFFIX: Final = ".pt"
NEEDED: Final = "torch 2.6 and Ultralytics 8.4.175"
"""What the extra [detector] asks for; Ultralytics before 8.4.68 does not read weights as data alone."""
NO_PICKLE: Final = "damaged, or not written by torch"
"""What it means where all that an error says is a number out of the file."""
SHOUTED: Final = "ERROR \u274c\ufe0f "
DEFAULT_SIDE: Final = 640
"""What Ultralytics trains at unless told otherwise."""


@dataclass(frozen=True, slots=True)
class Weights:
    """A loaded checkpoint.

    digest: of the file's content. longest: the input's longer side in training, in pixels. refiner: of its masks, if
    the file has one and it is wanted.
    """

    path: Path
    digest: str
    yolo: Any
    names: Mapping[int, str]
    segments: bool
    longest: int
    stride: int
    refiner: RefinerNetwork | None


def load_weights(model: str, option: str = "--model", *, refine: bool = True) -> Weights:
    """Read a checkpoint; nothing in it is executed. refine: with its refiner.

    Raises:
        ModelError: the file is no checkpoint, or of a task that finds no objects, or would be executed.
    """
    if not getattr(getattr(tasks, "_SafeLoad", None), "SUPPORTED", False):
        raise ModelError(f"{option} {model}: what is in it would be executed: {NEEDED} or later are needed")
    if not model.endswith(SUFFIX):
        raise ModelError(f"{option} {model}: Ultralytics weights end in {SUFFIX}; --runtime makes the rest of them")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is wrong is said in one line
            yolo: Any = YOLO(model)
        path = Path(yolo.ckpt_path)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        names = {int(label): str(name) for label, name in yolo.model.names.items()}
        stride = max(32, int(yolo.model.stride.max()))
        longest = _longest(yolo)
        masks = getattr(yolo.model.model[-1], "nm", None)  # what Ultralytics calls the number of its prototypes
        refiner = network_in(yolo.ckpt or {}, len(names), masks) if refine and masks is not None else None
    except Exception as error:
        why = NO_PICKLE if isinstance(error, LookupError) else first_line(error).removeprefix(SHOUTED)
        raise ModelError(f"{option} {model}: not a model that can be used: {why}") from error
    if yolo.task not in TASKS:
        raise ModelError(f"{option} {model}: a model for {yolo.task!r}, not for one of {', '.join(TASKS)}")
    return Weights(path, digest, yolo, names, yolo.task == SEGMENT, longest, stride, refiner)


def _longest(yolo: Any) -> int:
    """Return the longer side of the input that the model was trained at."""
    side = (yolo.ckpt or {}).get("train_args", {}).get("imgsz", DEFAULT_SIDE)
    return int(max(side) if isinstance(side, list | tuple) else side)


def device_of(name: str | None) -> torch.device:
    """Return the device of a name that Ultralytics knows, or the best there is.

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
    """Return the type of the device that is asked for; numbers alone are those of GPUs."""
    kind = name.strip().partition(":")[0].lower()
    return kind if kind.isalpha() else "cuda"
