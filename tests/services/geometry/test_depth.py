from typing import Any

import numpy as np
import pytest
from backports import zstd
from numpy.typing import NDArray

from schemas.image import ImageFrame
from services.geometry.depth import Depth, read_depth
from services.geometry.errors import DepthError, PayloadError
from tests.schemas.frames import header
from tests.schemas.pictures import compressed, file_of

NAN = float("nan")
MILLIMETRES = np.array([[0, 1, 2310], [65535, 500, 8000]], np.uint16)
METRES = [[NAN, 0.001, 2.31], [65.535, 0.5, 8.0]]


def to_metres(image: ImageFrame, **limits: float) -> NDArray[np.float32]:
    return read_depth(image, **limits).metres()


def frame(values: NDArray[Any], encoding: str, *, padding: int = 0, **more: Any) -> ImageFrame:
    height, width = values.shape
    rows = values.view(np.uint8).reshape(height, -1)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    return ImageFrame(
        header=header(),
        height=height,
        width=width,
        encoding=encoding,
        step=data.shape[1],
        data=memoryview(data.tobytes()),
        **more,
    )


def same(found: NDArray[np.float32], expected: list[list[float]]) -> bool:
    return found.dtype == np.float32 and np.allclose(found, expected, rtol=1e-6, equal_nan=True)


@pytest.mark.parametrize("padding", [0, 2, 3])
def test_millimetres_in_either_byte_order_and_with_padded_rows(padding: int) -> None:
    assert same(to_metres(frame(MILLIMETRES, "16UC1", padding=padding)), METRES)
    swapped = frame(MILLIMETRES.byteswap(), "16UC1", padding=padding, is_bigendian=True)
    assert same(to_metres(swapped), METRES)


def test_every_number_of_millimetres_is_rounded_once() -> None:
    numbers = np.arange(1 << 16, dtype=np.uint16).reshape(256, 256)
    found = to_metres(frame(numbers, "16UC1"), nearest_m=0.1, farthest_m=20.0)
    expected = np.where((numbers >= 100) & (numbers <= 20_000), numbers / np.float32(1000), np.float32(NAN))
    assert np.array_equal(found, expected.astype(np.float32), equal_nan=True)
    assert found[0, 1] != to_metres(frame(numbers, "16UC1"))[0, 1] == np.float32(0.001)


def test_metres_and_what_is_no_reading() -> None:
    values = np.array([[0, NAN, np.inf], [-np.inf, -1, 2.5]], np.float32)
    expected = [[NAN, NAN, NAN], [NAN, NAN, 2.5]]
    assert same(to_metres(frame(values, "32FC1")), expected)
    assert same(to_metres(frame(values.byteswap(), "32FC1", is_bigendian=True)), expected)


def test_what_is_beyond_the_limits_is_no_reading_and_the_limits_are_within() -> None:
    found = to_metres(frame(MILLIMETRES, "16UC1"), nearest_m=0.5, farthest_m=2.31)
    assert same(found, [[NAN, NAN, 2.31], [NAN, 0.5, NAN]])


def test_depth_as_gateways_compress_it() -> None:
    raw = MILLIMETRES.tobytes()
    assert same(to_metres(compressed(zstd.compress(raw), "16UC1", 6, kind="zstd", height=2, width=3)), METRES)
    assert same(to_metres(compressed(file_of(MILLIMETRES, ".png"), "16UC1", 6, height=2, width=3)), METRES)


def test_inverse_depth_of_ros_compressed_depth() -> None:
    a, b = 100.0, -10.0
    values = np.array([[0, 1, 40]], np.uint16)
    picture = compressed(file_of(values, ".png"), "32FC1", 12, height=1, width=3, inverse_depth=(a, b))
    assert same(to_metres(picture), [[NAN, 100 / 11, 2.0]])


def test_inverse_depth_that_divides_by_nothing_is_no_reading() -> None:
    picture = compressed(
        file_of(np.array([[3]], np.uint16), ".png"), "32FC1", 4, height=1, width=1, inverse_depth=(1, 3)
    )
    assert np.isnan(to_metres(picture)).all()


def test_a_picture_is_no_depth() -> None:
    with pytest.raises(DepthError, match="an image in mono16, which is no depth"):
        to_metres(frame(MILLIMETRES, "mono16"))


def test_damaged_data_is_said_to_be() -> None:
    file = file_of(MILLIMETRES, ".png")
    with pytest.raises(DepthError, match="png that cannot be decoded"):
        to_metres(compressed(file[:60], "16UC1", 6, height=2, width=3))
    held = zstd.compress(MILLIMETRES.tobytes())
    with pytest.raises(PayloadError):
        to_metres(compressed(held[:-2], "16UC1", 6, kind="zstd", height=2, width=3))


def test_metres_are_those_of_the_place_that_is_asked_for() -> None:
    for values, encoding in ((MILLIMETRES, "16UC1"), (MILLIMETRES / np.float32(1000), "32FC1")):
        image = read_depth(frame(values, encoding))
        assert image.shape == (2, 3)
        assert same(image.metres((slice(1, 2), slice(0, 2))), [[65.535, 0.5]])
        assert image.metres((slice(0, 0), slice(0, 0))).shape == (0, 0)
        assert np.array_equal(image.metres_of(np.array([[4, 3], [2, 9]])), image.metres().reshape(-1)[[[4, 3], [2, 5]]])
    already = np.ones((2, 2), np.float32)
    assert Depth(already).metres().tolist() == already.tolist()


def test_a_small_file_that_stands_for_a_very_large_image_is_not_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.geometry.depth.MAX_PIXELS", 5)
    with pytest.raises(DepthError, match="depth of 3x2 pixels, at most 5 are read"):
        read_depth(frame(MILLIMETRES, "16UC1"))
