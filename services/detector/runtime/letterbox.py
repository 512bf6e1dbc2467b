"""Fits images of any size into a model's input, and maps coordinates back to the image. Pure."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

PADDING: Final = 114
"""The grey around a letterboxed image, as in training."""


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis of the image and of the model's input, in pixels.

    image: size of the image; content: size it is scaled to; before: padding in front of it, or, negative, what is cut
    off there; input: size of all of it.
    """

    image: int
    content: int
    before: int
    input: int

    @property
    def shown(self) -> tuple[float, float]:
        """The part of the image that fills the input, where something is cut off."""
        scale = self.image / self.content
        return -self.before * scale, min((self.input - self.before) * scale, self.image)

    def to_image(self, places: NDArray[np.float32]) -> NDArray[np.float32]:
        """Map coordinates of the input to the image, clipped to its borders."""
        return np.asarray(np.clip(self.beyond(places), 0, self.image), np.float32)

    def beyond(self, places: NDArray[np.float32]) -> NDArray[np.float32]:
        """Map coordinates of the input to the image and beyond its borders."""
        return np.asarray((places - np.float32(self.before)) * np.float32(self.image / self.content), np.float32)


@dataclass(frozen=True, slots=True)
class Letterbox:
    """The placement of an image in a model's input: scaled and padded to fit, or stretched to fill it.

    smooth: whether pixels of an image that is made smaller are averages of all that they stand for.
    """

    rows: Axis
    columns: Axis
    smooth: bool = False

    @classmethod
    def fit(
        cls,
        height: int,
        width: int,
        longest: int,
        stride: int,
        *,
        stretched: bool = False,
        fixed: tuple[int, int] | None = None,
    ) -> "Letterbox":
        """Scale an image's longer side to `longest` and pad it to the smallest input, as Ultralytics' `rect` does.

        All in pixels; the input's sides are multiples of `stride`. stretched: both sides to `longest`, as RT-DETR's.
        fixed: height and width of the only input that the model takes, which is padded to instead.
        """
        if fixed is not None:
            sides = zip((height, width), fixed, strict=True)
            scale = min(side / size for size, side in sides)
            size = fixed if stretched else (round(height * scale), round(width * scale))
            rows, columns = (_placed(*each) for each in zip((height, width), size, fixed, strict=True))
            return cls(rows, columns)
        if stretched:
            side = longest + -longest % stride
            return cls(Axis(height, side, 0, side), Axis(width, side, 0, side))
        scale = min(longest / height, longest / width)
        return cls(_axis(height, scale, stride), _axis(width, scale, stride))

    @classmethod
    def crop(cls, height: int, width: int, size: tuple[int, int]) -> "Letterbox":
        """Have an image fill an input of `size`, height and width, as models that classify take it.

        A square input shows the middle of it, another one all of it, stretched.
        """
        sides = size if size[0] != size[1] else [side * size[0] // min(height, width) for side in (height, width)]
        rows, columns = (
            Axis(image, content, -round((content - side) / 2), side)
            for image, content, side in zip((height, width), sides, size, strict=True)
        )
        return cls(rows, columns, smooth=True)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the model's input."""
        return self.rows.input, self.columns.input

    def apply(self, bgr: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
        """Write a BGR image into the input `out`, height x width x 3 in RGB."""
        rows, columns = self.rows, self.columns
        if self.smooth:
            (left, right), (top, bottom) = columns.shown, rows.shown
            image = Image.fromarray(np.ascontiguousarray(bgr[..., ::-1]))
            size, how = (columns.input, rows.input), Image.Resampling.BILINEAR
            out[...] = np.asarray(image.resize(size, how, box=(left, top, right, bottom)))
            return
        if bgr.shape[:2] != (rows.content, columns.content):
            bgr = np.asarray(cv2.resize(bgr, (columns.content, rows.content), interpolation=cv2.INTER_LINEAR), np.uint8)
        if (rows.content, columns.content) == self.shape:
            cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB, dst=out)
            return
        out[...] = PADDING
        top, left = rows.before, columns.before
        out[top : top + rows.content, left : left + columns.content] = bgr[..., ::-1]


def _axis(size: int, scale: float, stride: int) -> Axis:
    content = max(round(size * scale), 1)
    return _placed(size, content, content + -content % stride)


def _placed(size: int, content: int, side: int) -> Axis:
    """Return the axis of an image of this size in the middle of an input's side."""
    content = max(content, 1)
    return Axis(size, content, round((side - content) / 2 - 0.1), side)
