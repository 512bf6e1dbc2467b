"""Model files with random weights, built from the architectures that Ultralytics ships: nothing is downloaded.

Import what is here after `keep_offline` only: Ultralytics reads its environment when it is imported.
"""

from pathlib import Path
from typing import Any, Final

import torch
from torch import nn
from torch.nn.functional import interpolate, normalize
from ultralytics.nn import tasks
from ultralytics.nn.modules import head as heads
from ultralytics.nn.modules.block import ContrastiveHead
from ultralytics.utils import ROOT

CLASSES: Final = 4
SIDE: Final = 128
"""Longer side in pixels of the input that the models are made for."""

DETECTING: Final = (heads.Detect, heads.RTDETRDecoder)
OF_OTHER_TASKS: Final = (heads.OBB, heads.Pose)


TASKS: Final = {
    tasks.SegmentationModel: "segment",
    tasks.OBBModel: "obb",
    tasks.PoseModel: "pose",
    tasks.ClassificationModel: "classify",
}


def architectures() -> dict[str, str]:
    """Return the name of the head of each of Ultralytics' architectures that finds objects, by file name."""
    found = {}
    for file in sorted((ROOT / "cfg" / "models").rglob("*.yaml")):
        head = getattr(heads, tasks.yaml_model_load(file)["head"][-1][2])
        if issubclass(head, DETECTING) and not issubclass(head, OF_OTHER_TASKS):
            found[file.name] = head.__name__
    return found


def build(architecture: str, *, seed: int = 0, classes: int = CLASSES, channels: int = 3) -> Any:
    """Return a module whose features vary across an image, so that it finds objects of any score.

    architecture: a file's name, with the letter of a size, such as `yolo11n-seg.yaml`.
    """
    torch.manual_seed(seed)
    config = tasks.yaml_model_load(architecture)
    model: Any = _model_class(config)(config, ch=channels, nc=classes, verbose=False)
    head = model.model[-1]
    if isinstance(model, tasks.YOLOEModel):
        texts = normalize(torch.randn(1, classes, head.embed), dim=2)
        model.set_classes([str(each) for each in range(classes)], texts)
    _vary_head(head)
    images = interpolate(torch.rand(6, channels, SIDE // 8, SIDE // 8), SIDE, mode="bicubic").clamp(0, 1)
    _normalise(model, images)
    _scatter_scores(model, images)
    return model.eval()


def write(model: Any, file: Path, **entries: object) -> Path:
    """Save a module as Ultralytics' training does. entries: beside it in the checkpoint."""
    task = next((task for kind, task in TASKS.items() if isinstance(model, kind)), "detect")
    torch.save({"model": model.half(), "train_args": {"imgsz": SIDE, "task": task}, **entries}, file)
    model.float()
    return file


def _model_class(config: dict[str, Any]) -> Any:
    head = getattr(heads, config["head"][-1][2])
    for kind, model in (
        (heads.RTDETRDecoder, tasks.RTDETRDetectionModel),
        (heads.WorldDetect, tasks.WorldModel),
        (heads.YOLOESegment, tasks.YOLOESegModel),
        (heads.YOLOEDetect, tasks.YOLOEModel),
        (heads.Segment, tasks.SegmentationModel),
        (heads.OBB, tasks.OBBModel),
        (heads.Pose, tasks.PoseModel),
        (heads.Classify, tasks.ClassificationModel),
    ):
        if issubclass(head, kind):
            return model
    return tasks.DetectionModel


def _vary_head(head: Any) -> None:
    """Have the two branches of a head find different things, and boxes overlap those beside them."""
    for name, layer in head.named_modules():
        if isinstance(layer, nn.Conv2d) and name.startswith("one2one_"):
            layer.reset_parameters()
    if getattr(head, "reg_max", None) == 1:
        for layer in (each[-1] for name in ("cv2", "one2one_cv2") for each in getattr(head, name)):
            nn.init.constant_(layer.bias, 5)


def _normalise(model: Any, images: torch.Tensor) -> None:
    """Have every layer put out numbers of the same spread: random weights alone fade to nothing."""
    layers: list[Any] = [each for each in model.modules() if isinstance(each, nn.BatchNorm2d)]
    for each in layers:
        each.momentum = None
        each.reset_running_stats()
    model.train()
    with torch.no_grad():
        model(images)
        for each in layers:
            each.running_var.clamp_(min=float(each.running_var.mean()))


def _scatter_scores(model: Any, images: torch.Tensor) -> None:
    """Spread the scores between 0 and 1, most of them low."""
    head = model.model[-1]
    contrasts = [each for name in ("cv4", "one2one_cv4") for each in getattr(head, name, None) or ()]
    if contrasts and hasattr(contrasts[0], "logit_scale"):  # classes are told by how they agree with texts
        for each in contrasts:
            unit = isinstance(each, ContrastiveHead)
            nn.init.constant_(each.logit_scale, 3.5 if unit else 0.5)
            nn.init.constant_(each.bias, -2 if unit else -0.5)
        return
    branches = (getattr(head, name, None) for name in ("cv3", "one2one_cv3"))
    last = [each[-1] for branch in branches for each in branch or ()] + list(getattr(head, "dec_score_head", ()))[-1:]
    hooks = [each.register_forward_hook(_spread) for each in last]
    with torch.no_grad():
        model.eval()(images)
    for hook in hooks:
        hook.remove()


def _spread(layer: Any, _inputs: object, found: torch.Tensor) -> None:
    factor = 1.5 / found.std()
    layer.bias.data = (layer.bias.data - found.mean()) * factor - 2
    layer.weight.data *= factor
