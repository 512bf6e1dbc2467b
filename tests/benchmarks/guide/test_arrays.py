from dataclasses import dataclass

import numpy as np
import pytest

from benchmarks.guide.arrays import layout, pixels


@dataclass
class Field:
    name: str
    offset: int
    datatype: int


def test_colour() -> None:
    found = pixels(bytes(range(12)), "rgb8", 2, 2)
    assert found.tolist() == [[[0, 1, 2], [3, 4, 5]], [[6, 7, 8], [9, 10, 11]]]


def test_depth_in_millimetres_and_in_metres() -> None:
    assert pixels(b"\x01\x00\x00\x01", "16UC1", 1, 2).tolist() == [[1, 256]]
    assert pixels(np.array([[1.5], [2.5]], "<f4").tobytes(), "32FC1", 2, 1).tolist() == [[1.5], [2.5]]


def test_an_encoding_that_the_guide_has_not() -> None:
    with pytest.raises(KeyError):
        pixels(b"", "mono8", 0, 0)


def test_points_with_padding_and_other_fields() -> None:
    kind = layout([Field("x", 0, 7), Field("ring", 4, 4), Field("rgb", 8, 7)], 16)
    assert (kind.names, kind.itemsize) == (("x", "rgb"), 16)
    points = np.frombuffer(np.array([1, 0, 3, 0, 5, 0, 7, 0], "<f4").tobytes(), kind)
    assert (points["x"].tolist(), points["rgb"].tolist()) == ([1, 5], [3, 7])
