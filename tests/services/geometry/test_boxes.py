import math

import numpy as np
import pytest

from schemas.objects import UprightBox
from services.geometry.boxes import axes_of


def box(yaw: float, up: tuple[float, float, float]) -> UprightBox:
    return UprightBox(centre=(0.0, 0.0, 0.0), size=(1.0, 1.0, 1.0), yaw=yaw, up=up)


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_axes_are_right_handed_and_upright(up: tuple[float, float, float]) -> None:
    axes = axes_of(box(0.4, up))
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1)
    assert axes[2] == pytest.approx(up if any(up) else (0, 0, 1))


def test_yaw_turns_counter_clockwise_from_x() -> None:
    length, width, _ = axes_of(box(math.pi / 6, (0.0, 0.0, 1.0)))
    assert length == pytest.approx((math.cos(math.pi / 6), 0.5, 0))
    assert width == pytest.approx((-0.5, math.cos(math.pi / 6), 0))
