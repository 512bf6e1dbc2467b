"""The network that refines masks: a U-Net (Ronneberger et al., 2015) of four sizes for close-ups of single objects.

It also tells how good each mask has become, as Mask Scoring R-CNN does (Huang et al., 2019): the IoU to expect with the
true mask, 0 where there is no such object.
"""

import io
import warnings
from typing import Any, Final

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate
from torch.nn.utils.fusion import fuse_conv_bn_eval

from services.detector.runtime.refinement.refiner import CHANNELS, COARSE, blank_close_ups

WIDTHS: Final = (12, 24, 48, 64)
"""Channels at the whole size, at a half, a quarter and an eighth."""

JUDGING: Final = 32
"""Channels that a mask's quality is told from."""

STEEPNESS: Final = 8.0
"""Log odds of what the coarse mask is sure of."""

OPSET: Final = 17
NAMES: Final = ("pixels", "features", "labels", "scores", "odds", "qualities")
"""Inputs, as `CloseUps` has them, and outputs; the first dimension of each is any number of objects."""


class Layer(nn.Sequential):
    """A 3 x 3 convolution, its normalisation and ReLU."""

    def __init__(self, before: int, after: int, stride: int = 1) -> None:
        convolution = nn.Conv2d(before, after, 3, stride=stride, padding=1, bias=False)
        super().__init__(convolution, nn.BatchNorm2d(after), nn.ReLU(inplace=True))

    def fuse(self) -> None:
        """Fuse the convolution and its normalisation once training is done."""
        convolution: Any = self[0]
        normalising: Any = self[1]
        if not isinstance(normalising, nn.Identity):
            self[0], self[1] = fuse_conv_bn_eval(convolution, normalising), nn.Identity()


class RefinerNetwork(nn.Module):
    """Refines the masks of a model with this many classes and prototypes.

    What the model made of a place, its prototypes and the class, is added where the network has seen least yet.
    """

    def __init__(self, classes: int, prototypes: int) -> None:
        super().__init__()
        self.prototypes = prototypes
        whole, half, quarter, eighth = WIDTHS
        self.of_class = nn.Embedding(classes, half)
        self.of_features = nn.Sequential(nn.BatchNorm2d(prototypes), nn.Conv2d(prototypes, half, 3, padding=1))
        self.down_half = nn.Conv2d(CHANNELS, half, 3, stride=2, padding=1)
        self.at_half = nn.Sequential(nn.BatchNorm2d(half), nn.ReLU(inplace=True), Layer(half, half))
        self.at_quarter = nn.Sequential(Layer(half, quarter, 2), Layer(quarter, quarter))
        self.at_eighth = nn.Sequential(Layer(quarter, eighth, 2), Layer(eighth, eighth), Layer(eighth, eighth))
        self.up_quarter, self.back_quarter = nn.Conv2d(eighth, quarter, 1), Layer(quarter, quarter)
        self.up_half, self.back_half = nn.Conv2d(quarter, half, 1), Layer(half, half)
        self.up_whole, self.back_whole = nn.Conv2d(half, whole, 1), Layer(CHANNELS + whole, whole)
        self.out = nn.Conv2d(whole, 1, 3, padding=1)
        self.quality = nn.Sequential(nn.Linear(eighth + 2, JUDGING), nn.ReLU(inplace=True), nn.Linear(JUDGING, 1))
        nn.init.zeros_(self.out.weight)
        assert self.out.bias is not None  # noqa: S101 - what nn.Conv2d makes unless told otherwise
        nn.init.zeros_(self.out.bias)

    def forward(self, close_ups: Tensor, features: Tensor, labels: Tensor, scores: Tensor) -> tuple[Tensor, Tensor]:
        """Return the log odds of the objects' masks, n x side x side, and of their qualities, n.

        close_ups: n x side x side x CHANNELS, bytes; the side is a multiple of 8. features: n x side / 2 x side / 2 x
        prototypes. labels, scores: n.
        """
        seen = close_ups.permute(0, 3, 1, 2).float().div_(255).sub_(0.5)
        made_of_it = self.of_features(features.permute(0, 3, 1, 2).float()) + self.of_class(labels)[:, :, None, None]
        half = self.at_half(self.down_half(seen) + made_of_it)
        quarter = self.at_quarter(half)
        eighth = self.at_eighth(quarter)
        found = self.back_quarter(_twice(self.up_quarter(eighth)) + quarter)
        found = self.back_half(_twice(self.up_half(found)) + half)
        found = self.back_whole(torch.cat([_twice(self.up_whole(found)), seen], dim=1))
        odds: Tensor = self.out(found)[:, 0] + STEEPNESS * seen[:, COARSE]
        expected = torch.stack([expected_iou(odds.detach()), scores.float().logit(1e-6)], dim=1)
        quality: Tensor = self.quality(torch.cat([eighth.mean((2, 3)), expected], dim=1))[:, 0]
        return odds, quality

    def fuse(self) -> None:
        """Fuse all layers: a fifth quicker, but no longer trainable."""
        for module in list(self.modules()):
            if isinstance(module, Layer):
                module.fuse()


def expected_iou(odds: Tensor) -> Tensor:
    """Return the expected IoU of masks with the true ones if the log odds, n x rows x columns, are right."""
    likely, mask = odds.sigmoid(), odds > 0
    right = (likely * mask).sum((1, 2))
    return right / (mask + likely * ~mask).sum((1, 2)).clamp_min(1)


def _twice(planes: Tensor) -> Tensor:
    return interpolate(planes, scale_factor=2.0, mode="bilinear", align_corners=False)


def onnx_of(network: RefinerNetwork) -> bytes:
    """Return a network as the content of an ONNX file, for libraries other than torch. It can no longer be trained."""
    network.eval().fuse()
    seen = blank_close_ups(2, network.prototypes)
    example = tuple(map(torch.from_numpy, (seen.pixels, seen.features, seen.labels, seen.scores)))
    file: Any = io.BytesIO()  # its types know of paths alone
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch would rather have another exporter used, which needs more packages
        torch.onnx.export(
            network,
            example,
            file,
            input_names=NAMES[: len(example)],
            output_names=NAMES[len(example) :],
            dynamic_axes={name: {0: "objects"} for name in NAMES},
            opset_version=OPSET,
            dynamo=False,
        )
    content: bytes = file.getvalue()
    return content
