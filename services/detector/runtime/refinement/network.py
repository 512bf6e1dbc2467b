"""The network that refines masks: a U-Net (Ronneberger et al., 2015) of three sizes for close-ups of single objects.

It works at half the size of a close-up, whose pixels it takes, and whose mask it gives, four at a time (Shi et al.,
"Real-time single image and video super-resolution using an efficient sub-pixel convolutional neural network", 2016): a
few channels at the whole size took most of the time.

It also tells how good each mask has become, as Mask Scoring R-CNN does (Huang et al., 2019): the IoU to expect with the
true mask, 0 where there is no such object.
"""

from collections.abc import Mapping
from typing import Any, Final

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, pixel_shuffle, pixel_unshuffle
from torch.nn.utils.fusion import fuse_conv_bn_eval

from services.detector.runtime.refinement.refiner import CHANNELS, COARSE

WIDTHS: Final = (16, 32, 64)
"""Channels at a half of the size, a quarter and an eighth."""

EARLIER_WIDTHS: Final = (24, 48, 64)
EARLIER_WHOLE: Final = 12
"""Channels at the whole size, which networks of earlier releases have."""

JUDGING: Final = 32
"""Channels that a mask's quality is told from."""

STEEPNESS: Final = 8.0
"""Log odds of what the coarse mask is sure of."""


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

    def __init__(self, classes: int, prototypes: int, widths: tuple[int, int, int] = WIDTHS) -> None:
        super().__init__()
        self.prototypes = prototypes
        half, quarter, eighth = widths
        self.of_class = nn.Embedding(classes, half)
        self.of_features = nn.Sequential(nn.BatchNorm2d(prototypes), nn.Conv2d(prototypes, half, 1))
        self.down_half = nn.Conv2d(CHANNELS, half, 3, stride=2, padding=1)
        self.at_half = nn.Sequential(nn.BatchNorm2d(half), nn.ReLU(inplace=True), Layer(half, half))
        self.at_quarter = nn.Sequential(Layer(half, quarter, 2), Layer(quarter, quarter))
        self.at_eighth = nn.Sequential(Layer(quarter, eighth, 2), Layer(eighth, eighth), Layer(eighth, eighth))
        self.up_quarter, self.back_quarter = nn.Conv2d(eighth, quarter, 1), Layer(quarter, quarter)
        self.up_half, self.back_half = nn.Conv2d(quarter, half, 1), Layer(half, half)
        self.quality = nn.Sequential(nn.Linear(eighth + 2, JUDGING), nn.ReLU(inplace=True), nn.Linear(JUDGING, 1))
        self._add_ending(half)

    def _add_ending(self, half: int) -> None:
        """Add the layers from half the size, with so many channels, to the whole."""
        self.pixels = nn.Conv2d(4 * CHANNELS, half, 1)
        self.out = _knowing_nothing(nn.Conv2d(half, 4, 3, padding=1))

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
        odds = self._ended(_twice(self.up_half(found)) + half, seen) + STEEPNESS * seen[:, COARSE]
        expected = torch.stack([expected_iou(odds.detach()), scores.float().logit(1e-6)], dim=1)
        quality: Tensor = self.quality(torch.cat([eighth.mean((2, 3)), expected], dim=1))[:, 0]
        return odds, quality

    def _ended(self, half: Tensor, seen: Tensor) -> Tensor:
        """Return what is found at half the size, and the close-ups, as log odds at the whole."""
        found = self.back_half(half + self.pixels(pixel_unshuffle(seen, 2)))
        return pixel_shuffle(self.out(found), 2)[:, 0]

    def fuse(self) -> None:
        """Fuse all layers: a fifth quicker, but no longer trainable."""
        for module in list(self.modules()):
            if isinstance(module, Layer):
                module.fuse()


class EarlierNetwork(RefinerNetwork):
    """The network in weights that releases before 0.3 trained: wider, and with layers at the whole size."""

    def __init__(self, classes: int, prototypes: int) -> None:
        super().__init__(classes, prototypes, EARLIER_WIDTHS)

    def _add_ending(self, half: int) -> None:
        self.of_features[1] = nn.Conv2d(self.prototypes, half, 3, padding=1)
        self.up_whole = nn.Conv2d(half, EARLIER_WHOLE, 1)
        self.back_whole = Layer(CHANNELS + EARLIER_WHOLE, EARLIER_WHOLE)
        self.out = _knowing_nothing(nn.Conv2d(EARLIER_WHOLE, 1, 3, padding=1))

    def _ended(self, half: Tensor, seen: Tensor) -> Tensor:
        found = self.back_whole(torch.cat([_twice(self.up_whole(self.back_half(half))), seen], dim=1))
        odds: Tensor = self.out(found)[:, 0]
        return odds


def network_like(state: Mapping[str, Any] | None, classes: int, prototypes: int) -> RefinerNetwork:
    """Return a network that knows nothing yet: of the release that the state of a network is of, if there is one."""
    earlier = state is not None and "up_whole.weight" in state
    return EarlierNetwork(classes, prototypes) if earlier else RefinerNetwork(classes, prototypes)


def expected_iou(odds: Tensor) -> Tensor:
    """Return the expected IoU of masks with the true ones if the log odds, n x rows x columns, are right."""
    likely, mask = odds.sigmoid(), odds > 0
    right = (likely * mask).sum((1, 2))
    return right / (mask + likely * ~mask).sum((1, 2)).clamp_min(1)


def _twice(planes: Tensor) -> Tensor:
    return interpolate(planes, scale_factor=2.0, mode="bilinear", align_corners=False)


def _knowing_nothing(layer: nn.Conv2d) -> nn.Conv2d:
    """Return a last layer that adds nothing to the coarse masks."""
    nn.init.zeros_(layer.weight)
    assert layer.bias is not None  # noqa: S101 - what nn.Conv2d makes unless told otherwise
    nn.init.zeros_(layer.bias)
    return layer
