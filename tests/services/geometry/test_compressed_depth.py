"""Depth as ROS's compressed_depth_image_transport sends it: through a gateway, and in metres again."""

import struct

import numpy as np
import pytest

from schemas.image import ImageFrame
from services.geometry.depth import read_depth
from tests.gateway.sensing import compressed
from tests.gateway.to_bus.translators.translating import translated
from tests.schemas.pictures import file_of

NAN = float("nan")
NEAREST_M, FARTHEST_M = 100.0, 10.0
"""The transport's `depth_quantization` and `depth_max` unless told otherwise."""


def test_metres_are_quantized_by_their_inverse() -> None:
    metres = np.array([[0.5, 1.0, 2.31], [5.0, 9.9, NAN]])
    a = NEAREST_M * (NEAREST_M + 1)
    b = 1 - a / FARTHEST_M
    inverse = np.nan_to_num(np.floor(a / metres + b + 0.5)).astype(np.uint16)
    sent = struct.pack("<iff", 0, a, b) + file_of(inverse, ".png")
    frame = translated(ImageFrame, "front/depth", compressed("32FC1; compressedDepth png", sent))
    found = read_depth(frame).metres()
    assert np.isnan(found).tolist() == np.isnan(metres).tolist()
    assert found[0] == pytest.approx(metres[0], rel=3e-4)
    assert found[1, :2] == pytest.approx(metres[1, :2], rel=1e-3)


def test_millimetres_are_sent_as_they_are() -> None:
    millimetres = np.array([[0, 1, 2310], [65535, 500, 8000]], np.uint16)
    sent = struct.pack("<iff", 0, 0.0, 0.0) + file_of(millimetres, ".png")
    found = read_depth(translated(ImageFrame, "front/depth", compressed("16UC1; compressedDepth png", sent))).metres()
    assert np.allclose(found, [[NAN, 0.001, 2.31], [65.535, 0.5, 8.0]], rtol=1e-6, equal_nan=True)
