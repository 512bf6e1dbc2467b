"""Boxes one by one."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.cloud.upright_boxes import Boxes, Level, fit

Numbers = NDArray[np.float64]


class Box(NamedTuple):
    """An upright box. size: length, width, height. yaw: of its length."""

    centre: Numbers
    size: Numbers
    yaw: float


def each(boxes: Boxes, level: Level) -> list[Box]:
    yaws = level.yaws(boxes.along).tolist()
    return [Box(*of) for of in zip(boxes.centres, boxes.sizes, yaws, strict=True)]


def fit_box(xyz: NDArray[np.float32], level: Level) -> Box:
    """Return the smallest box around (3, n) points."""
    low, high, angle = fit(xyz, level)
    (box,) = each(Boxes.between(low[None], high[None], np.array([angle]), level), level)
    return box
