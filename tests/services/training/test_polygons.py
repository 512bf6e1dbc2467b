import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.geometry.outlines import outline

Mask = NDArray[np.uint8]


def refilled(mask: Mask) -> Mask:
    polygon = outline(mask)
    assert polygon is not None
    return np.asarray(cv2.fillPoly(np.zeros_like(mask), [polygon], 1), np.uint8)


def iou(one: Mask, other: Mask) -> float:
    return float((one & other).sum() / (one | other).sum())


def disc(mask: Mask, centre: tuple[int, int], radius: int, value: int = 1) -> None:
    cv2.circle(mask, centre, radius, value, -1)


def test_a_disc_is_itself_again() -> None:
    mask = np.zeros((100, 120), np.uint8)
    disc(mask, (60, 50), 40)
    assert iou(refilled(mask), mask) > 0.97


def test_parts_stay_apart() -> None:
    mask = np.zeros((100, 200), np.uint8)
    for x in (30, 100, 170):
        disc(mask, (x, 50), 25)
    assert iou(refilled(mask), mask) > 0.95


def test_holes_stay_open() -> None:
    mask = np.zeros((200, 200), np.uint8)
    disc(mask, (100, 100), 90)
    disc(mask, (70, 100), 25, 0)
    disc(mask, (140, 100), 20, 0)
    assert iou(refilled(mask), mask) > 0.95


@pytest.mark.parametrize("size", [(0, 0), (1, 40), (4, 4)])
def test_slivers_have_no_outline(size: tuple[int, int]) -> None:
    mask = np.zeros((60, 60), np.uint8)
    mask[5 : 5 + size[0], 5 : 5 + size[1]] = 1
    assert outline(mask) is None


def test_a_mask_that_fills_its_window() -> None:
    mask = np.ones((40, 30), np.uint8)
    assert iou(refilled(mask), mask) == 1
