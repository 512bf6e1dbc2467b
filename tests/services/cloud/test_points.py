from typing import Any

import numpy as np
import pytest
from backports import zstd
from hypothesis import given
from hypothesis import strategies as st

from services.cloud import points as module
from services.cloud.points import CloudError, Points, usable
from services.geometry.errors import PayloadError
from tests.services.cloud.clouds import Layout, cloud_of, packed, xyz_cloud

SHAPE = (2, 3)
RNG = np.random.default_rng(0)
VALUES: dict[str, Any] = {axis: RNG.integers(-100, 100, SHAPE) for axis in "xyz"} | {
    "intensity": RNG.integers(0, 100, SHAPE)
}
RGB = RNG.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
XYZ = np.stack([VALUES[axis] for axis in "xyz"], axis=-1).reshape(-1, 3).T.astype(np.float32)


@st.composite
def layouts(draw: st.DrawFn) -> Layout:
    kinds = st.sampled_from(["i1", "i2", "i4", "f4", "f8"])
    fields = [(axis, draw(kinds)) for axis in ("x", "y", "z", "intensity")]
    fields += draw(st.sampled_from([[("rgb", "f4")], [("rgba", "u4")], [("rgb", "i4")], []]))
    return Layout(
        draw(st.permutations(fields)),
        draw(st.lists(st.integers(0, 9), max_size=5)),
        draw(st.booleans()),
        row_padding=draw(st.integers(0, 9)),
        tail=draw(st.integers(0, 9)),
    )


@given(layouts(), st.booleans())
def test_any_layout_reads_the_same(layout: Layout, compress: bool) -> None:  # noqa: FBT001
    kinds = dict(layout.fields)
    colours: dict[str, Any] = {name: packed(RGB, kinds[name]) for name in ("rgb", "rgba") if name in kinds}
    cloud = cloud_of({**VALUES, **colours}, layout)
    if compress:
        data = zstd.compress(cloud.data)
        cloud = cloud_of({**VALUES, **colours}, layout, format="zstd", data=memoryview(data))
    points = Points.of(cloud)
    assert points.shape == SHAPE
    assert points.xyz().dtype == np.float32
    assert np.array_equal(points.xyz(), XYZ)
    at = np.array([5, 0, 4])
    assert np.array_equal(points.take(at).xyz(), XYZ[:, at])
    for some, expected in ((points, RGB.reshape(-1, 3)), (points.take(at), RGB.reshape(-1, 3)[at])):
        rgb = some.rgb()
        assert (rgb is None) == (not colours)
        assert rgb is None or np.array_equal(rgb, expected)


def test_colours_may_be_a_field_each() -> None:
    channels = {name: RGB[..., at] for at, name in enumerate("rgb")}
    layout = Layout([("b", "u1"), ("x", "f4"), ("y", "f4"), ("z", "f4"), ("r", "u1"), ("g", "u1")])
    rgb = Points.of(cloud_of({**VALUES, **channels}, layout)).rgb()
    assert rgb is not None
    assert np.array_equal(rgb, RGB.reshape(-1, 3))


def test_what_is_called_rgb_and_is_none_is_no_colour() -> None:
    layout = Layout([("x", "f4"), ("y", "f4"), ("z", "f4"), ("rgb", "f8")])
    assert Points.of(cloud_of({**VALUES, "rgb": VALUES["x"]}, layout)).rgb() is None


def test_reading_a_cloud_copies_none_of_it() -> None:
    cloud = xyz_cloud(np.ones((4, 5, 3), np.float32))
    points = Points.of(cloud)
    assert np.shares_memory(points.records, np.frombuffer(cloud.data, np.uint8))


@pytest.mark.parametrize("missing", ["x", "y", "z"])
def test_a_cloud_without_a_coordinate_is_refused(missing: str) -> None:
    layout = Layout([(axis, "f4") for axis in "xyz" if axis != missing])
    with pytest.raises(CloudError, match=f"a cloud without {missing}"):
        Points.of(cloud_of(VALUES, layout))


def test_damaged_zstd_data_is_refused() -> None:
    whole = xyz_cloud(np.ones((4, 5, 3)))
    data = zstd.compress(whole.data)
    for damaged in (data[:-1], data[:9] + bytes(len(data) - 9), data + b"x"):
        with pytest.raises(PayloadError, match="a zstd that cannot be decoded"):
            Points.of(xyz_cloud(np.ones((4, 5, 3)), format="zstd", data=memoryview(damaged)))


def test_more_points_than_are_looked_at_are_refused_before_they_are_read() -> None:
    layout = Layout([(axis, "i1") for axis in "xyz"])
    values = {axis: np.zeros((1, module.MAX_POINTS + 1), np.int8) for axis in "xyz"}
    with pytest.raises(CloudError, match="4000001 points, at most 4000000"):
        Points.of(cloud_of(values, layout))


@pytest.mark.parametrize("shape", [(0, 0), (1, 0), (0, 4)])
def test_an_empty_cloud_has_no_points(shape: tuple[int, int]) -> None:
    points = Points.of(xyz_cloud(np.zeros((*shape, 3)), np.zeros((*shape, 3), np.uint8)))
    assert points.xyz().shape == (3, 0)
    assert points.rgb().shape == (0, 3)  # type: ignore[union-attr]


def test_one_row_is_not_organised() -> None:
    assert Points.of(xyz_cloud(np.zeros((2, 2, 3)))).is_organised
    assert not Points.of(xyz_cloud(np.zeros((1, 2, 3)))).is_organised
    assert not Points.of(xyz_cloud(np.zeros((2, 1, 3)))).is_organised


def test_no_reading_is_nan_infinite_or_the_origin() -> None:
    nan, inf = float("nan"), float("inf")
    xyz = np.array([[1, 2, 3], [nan, 0, 1], [0, 0, inf], [0, 0, 0], [0, 0, -1], [1, -inf, 1]], np.float32)
    assert usable(xyz.T).tolist() == [True, False, False, False, True, False]
    assert usable(np.array([[0, 0], [0, 0], [9_999, 10_001]], np.float32)).tolist() == [True, False]
    layout = Layout([(axis, "f8") for axis in "xyz"])
    far = Points.of(cloud_of({axis: np.full((1, 1), 1e300) for axis in "xyz"}, layout))
    assert not usable(far.xyz()).any()
