"""Selects the branch of a model's head: NMS-free models have two, one of which finds each object once."""

from typing import Any, Final

from ultralytics.nn.modules.head import Detect, RTDETRDecoder

from services.detector.runtime.checkpoint import CheckpointError
from services.detector.runtime.postprocess import Head

ONE_TO_ONE: Final = "one2one_"
"""How names of the parts of the NMS-free branch begin; the other's parts have the same names without."""


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
