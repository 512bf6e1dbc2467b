"""Trains on pictures that are labelled in part: for some classes only, or with boxes instead of masks.

Ultralytics' data sets know labelled objects and nothing else. So a label's class index carries, beside the class, its
kind: a whole object, an object of which the box alone is known, or a region where the class may be without a label.
As labels, regions go through every augmentation (mosaics included) like objects; the loss then tells them apart.
"""

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import torch


class LabelKind(IntEnum):
    """The kind of a label; `code` puts it together with the class."""

    OBJECT = 0
    UNKNOWN_REGION = 1
    BOX_ONLY = 2

    def code(self, class_index: int, classes: int) -> int:
        """Return the class index in the data set: `class_index + kind * classes`, of which there are so many."""
        return class_index + self * classes


def code_names(classes: Sequence[str]) -> list[str]:
    """Return the data set's names, in the order of the codes."""
    return [f"{name} {kind.name.lower()}" if kind else name for kind in LabelKind for name in classes]


def criterion(model: Any) -> Any:
    """Return the loss of a model of Ultralytics', in both of its branches where it has two; see `loss_class`."""
    from ultralytics.nn.modules import Segment  # noqa: PLC0415 - after load_ultralytics
    from ultralytics.utils.loss import E2ELoss  # noqa: PLC0415

    head = model.model[-1]
    loss = loss_class(masks=isinstance(head, Segment))
    return E2ELoss(model, loss) if getattr(head, "one2one_cv2", None) is not None else loss(model)


def loss_class(*, masks: bool = True) -> type:
    """Return the loss of models that find masks, or boxes alone; call it after `load_ultralytics`."""
    import torch  # noqa: PLC0415 - only the training needs it
    from ultralytics.utils.loss import v8DetectionLoss, v8SegmentationLoss  # noqa: PLC0415 - after load_ultralytics

    plain_loss: Any = v8SegmentationLoss if masks else v8DetectionLoss

    class PartialLabelsLoss(plain_loss):  # type: ignore[misc]
        """Ultralytics' loss, without the classes that a region leaves unknown and the masks that nobody drew.

        Needs masks in separate planes (`overlap_mask=False`).
        """

        def loss(self, preds: dict[str, Any], batch: dict[str, Any]) -> Any:
            kinds = batch["cls"].view(-1).div(self.nc, rounding_mode="floor")
            regions = kinds == LabelKind.UNKNOWN_REGION
            whole = batch | _picked(batch, ~regions) | {"cls": batch["cls"][~regions] % self.nc}
            self._box_only = self._per_image(kinds[~regions] == LabelKind.BOX_ONLY, whole["batch_idx"], preds)
            known = self._known(_picked(batch, regions), preds)
            plain = vars(self)["bce"]
            self.bce = _Masked(plain, known)
            try:
                return super().loss(preds, whole)
            finally:
                self.bce = plain

        def calculate_segmentation_loss(self, fg_mask: Any, masks: Any, target_gt_idx: Any, *more: Any) -> Any:
            drawn = fg_mask & ~self._box_only.gather(1, target_gt_idx.clamp(max=self._box_only.shape[1] - 1))
            if not drawn.any():
                return (more[2] * 0).sum() + (more[3] * 0).sum()
            return super().calculate_segmentation_loss(drawn, masks, target_gt_idx, *more)

        def _per_image(self, flags: Any, image: Any, preds: Mapping[str, Any]) -> Any:
            """Return the objects' flags as (images, most objects of an image), in the assigner's order."""
            image = image.view(-1).long()
            count = preds["scores"].shape[0]
            most = max(int(torch.bincount(image, minlength=count).max()) if len(image) else 0, 1)
            table = torch.zeros(count, most, dtype=torch.bool, device=flags.device)
            for each in range(count):
                mine = flags[image == each]
                table[each, : len(mine)] = mine
            return table

        def _known(self, regions: Mapping[str, Any], preds: Mapping[str, Any]) -> Any:
            """Return 1 for each (image, anchor, class) that the labels are complete for, else 0."""
            centres = _anchor_centres(preds["feats"])
            known = torch.ones(preds["scores"].shape[0], len(centres), self.nc, device=centres.device)
            for image, code, box in zip(
                regions["batch_idx"].view(-1).long(), regions["cls"].view(-1).long(), regions["bboxes"], strict=True
            ):
                inside = ((centres - box[:2]).abs() <= box[2:] / 2).all(dim=1)
                known[image, inside, code % self.nc] = 0
            return known

    return PartialLabelsLoss


class _Masked:
    """A loss per element that counts only what is known, and every object that is labelled all the same."""

    def __init__(self, plain: Any, known: "torch.Tensor") -> None:
        self._plain, self._known = plain, known

    def __call__(self, predicted: "torch.Tensor", target: "torch.Tensor") -> Any:
        return self._plain(predicted, target) * ((target > 0) | (self._known > 0))


def _picked(batch: Mapping[str, Any], which: Any) -> dict[str, Any]:
    return {name: batch[name][which] for name in ("cls", "bboxes", "batch_idx", "masks") if name in batch}


def _anchor_centres(features: Any) -> Any:
    """Return the anchors' centres (n, 2) in 0..1 of the picture, in the order of the predictions."""
    import torch  # noqa: PLC0415 - only the training needs it

    parts = []
    for feature in features:
        height, width = feature.shape[2:]
        y, x = torch.meshgrid(
            (torch.arange(height, device=feature.device) + 0.5) / height,
            (torch.arange(width, device=feature.device) + 0.5) / width,
            indexing="ij",
        )
        parts.append(torch.stack([x, y], dim=-1).view(-1, 2))
    return torch.cat(parts)
