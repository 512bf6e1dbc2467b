"""Reads the weights of a model: its task, classes, module, and the branch of its head."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from ultralytics.models import YOLO
from ultralytics.nn import tasks
from ultralytics.nn.modules.head import Classify, Detect, RTDETRDecoder
from ultralytics.utils.torch_utils import select_device

from services.detector.model import ModelError, first_line
from services.detector.runtime.checkpoint import DOWNLOADS, CheckpointError, read_checkpoint
from services.detector.runtime.model_file import (
    COLOURS,
    EXPORTS,
    Head,
    ModelFile,
    NamesError,
    TaskError,
    class_names,
    task_of,
)
from services.detector.runtime.refinement.network import RefinerNetwork
from services.detector.runtime.refinement.torch_refiner import network_in
from services.detector.runtime.torch_engine import on_a_thread_that_ends
from services.detector.settings import WEIGHTS_SUFFIX, is_weights

NEEDED: Final = "torch 2.6 and Ultralytics 8.4.175"
"""As the extra [detector] asks for; Ultralytics before 8.4.68 does not read weights as data alone."""
DEFAULT_SIDE: Final = 640
"""Longer side, in pixels, at which Ultralytics trains by default."""
NAMES_CURE: Final = "give its model one name for each class, numbered from 0, and save it again"

ONE_TO_ONE: Final = "one2one_"
"""How names of the parts of the NMS-free branch begin; the other's parts have the same names without."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights(ModelFile):
    """A loaded checkpoint. refiner: of its masks, if the file has one and it is wanted."""

    model: Any
    refiner: RefinerNetwork | None


@on_a_thread_that_ends
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
        task = task_of(module.task, getattr(module.model[-1], "kpt_shape", None))
        _check(module)
        head = head_of(module, nms=nms)
        names = module.names = _names(module)
        masks = getattr(module.model[-1], "nm", None)  # what Ultralytics calls the number of its prototypes
        return Weights(
            path=path,
            digest=hashlib.sha256(path.read_bytes()).hexdigest(),
            model=module,
            names=names,
            task=task,
            longest=_longest(content),
            stride=max(32, int(module.stride.max())),
            refiner=network_in(content, len(names), masks) if refine and masks is not None else None,
            head=head,
            agnostic=isinstance(module, tasks.YOLOEModel),
        )
    except ModelError:
        raise
    except TaskError as error:
        raise ModelError(f"{what}: {error}") from error
    except HeadError as error:
        raise ModelError(f"{'--nms' if nms else '--no-nms'} with {what}: {error}") from error
    except Exception as error:
        why = str(error) if isinstance(error, CheckpointError) else first_line(error)
        raise ModelError(f"{what}: not a model that can be used: {why}") from error


def _check(module: Any) -> None:
    """Raise CheckpointError for a model for images unlike a camera's."""
    channels = getattr(module, "yaml", {}).get("channels", COLOURS)
    if channels != COLOURS:
        raise CheckpointError(f"it is for images of {channels} channels, and cameras have {COLOURS}: train it on RGB")
    for step in getattr(getattr(module, "transforms", None), "transforms", ()):
        if np.any(np.asarray(getattr(step, "mean", 0)) != 0) or np.any(np.asarray(getattr(step, "std", 1)) != 1):
            raise CheckpointError(
                "it is for images of another mean and spread: train it with Ultralytics' own transforms"
            )


def _names(module: Any) -> dict[int, str]:
    """Return the names of a model's classes, by label.

    Raises:
        CheckpointError: they are not one for each class.
    """
    head = module.model[-1]
    classes = head.linear.out_features if isinstance(head, Classify) else head.nc
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


class HeadError(Exception):
    """The model has not the requested head; the message says why."""


def head_of(model: Any, *, nms: bool | None) -> Head:
    """Return how to read objects from a model's output. nms: as requested; None for Ultralytics' default.

    Raises:
        HeadError: the model has no such head.
        CheckpointError: its head is none that is known here.
    """
    head = model.model[-1]
    if isinstance(head, RTDETRDecoder):
        if nms:
            raise HeadError("an RT-DETR model finds each object once, and has no other head: leave --nms out")
        return "rt-detr"
    if isinstance(head, Classify):
        if nms is not None:
            raise HeadError("a model that classifies whole images finds no boxes: leave it out")
        return "nms"
    if not isinstance(head, Detect):
        raise CheckpointError(f"its head is a {type(head).__name__}, which is not known here: use YOLO or RT-DETR")
    if nms is False and not _has_one_to_one(head):
        raise HeadError("it has no NMS-free head, as YOLO26 and YOLOv10 have: leave --no-nms out")
    if nms and head.cv2 is None:
        raise HeadError("it has nothing left but its NMS-free head: leave --nms out")
    return "nms-free" if nms is False or head.cv2 is None else "nms"


def keep_branch(model: Any, head: Head) -> None:
    """Reduce the head to one branch, so that the output is the same under every runtime.

    What Ultralytics' own NMS-free head puts out is a choice of the best, of a number of objects that an exported file
    fixes; the branch itself puts out every place of the image, as any other.
    """
    module = model.model[-1]
    if head == "rt-detr" or not _has_one_to_one(module):
        return
    for name in [name for name in module._modules if name.startswith(ONE_TO_ONE)]:  # noqa: SLF001 - as Ultralytics does
        if head == "nms-free":
            setattr(module, name.removeprefix(ONE_TO_ONE), getattr(module, name))
        setattr(module, name, None)


def _has_one_to_one(head: Any) -> bool:
    return getattr(head, f"{ONE_TO_ONE}cv2", None) is not None
